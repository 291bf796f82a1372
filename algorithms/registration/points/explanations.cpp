#include "algorithms/registration/points/explanations.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::registration {
namespace {

using PointList = std::vector<Vector3d>;
using Kind = Explanation::Kind;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kFlat_mm = 3.0;
constexpr double kExact_mm = 1e-6; // a smaller residual is rounding
constexpr std::size_t kMaxReordered = 64;
constexpr std::size_t kMaxTwoWrong = 128;

struct LeastSquares {
  std::optional<PairedPose> T;
  double squares = kInfinity;
  std::size_t count = 0;

  [[nodiscard]] double rms() const { return std::sqrt(squares / static_cast<double>(count)); }
};

LeastSquares fit_lists(const PointList &source, const PointList &target) {
  LeastSquares out{fit_rigid(source, target), kInfinity, source.size()};
  if (out.T) {
    out.squares = 0.0;
    for (std::size_t i = 0; i < source.size(); ++i) {
      out.squares += (*out.T * source[i] - target[i]).squaredNorm();
    }
  }
  return out;
}

PointList without(std::span<const Vector3d> points, std::span<const std::size_t> left_out) {
  PointList out;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (std::find(left_out.begin(), left_out.end(), i) == left_out.end()) {
      out.push_back(points[i]);
    }
  }
  return out;
}

std::optional<Explanation> mirrored(const PointList &source, const PointList &target) {
  if (are_coplanar(source) || are_coplanar(target)) {
    return std::nullopt; // it is its own mirror image
  }
  PointList flipped = source;
  for (Vector3d &point : flipped) {
    point.x() = -point.x();
  }
  return Explanation{.kind = Kind::kMirrored, .rms_mm = fit_lists(flipped, target).rms(), .indices = {}};
}

// The ratio of the two spreads [Horn 1987, eq. 12: symmetric in the two lists].
Explanation scaled(const PointList &source, const PointList &target) {
  const double scale = spread_mm(target).norm() / spread_mm(source).norm();
  PointList larger = source;
  for (Vector3d &point : larger) {
    point *= scale;
  }
  return {.kind = Kind::kScaled, .rms_mm = fit_lists(larger, target).rms(), .scale = scale, .indices = {}};
}

Explanation best_without(const PointList &source, const PointList &target, std::size_t wrong) {
  Explanation best{.kind = Kind::kWrongPairs, .rms_mm = kInfinity, .indices = {}};
  const auto consider = [&](std::vector<std::size_t> left_out) {
    const double rms = fit_lists(without(source, left_out), without(target, left_out)).rms();
    if (rms < best.rms_mm) {
      best.rms_mm = rms;
      best.indices = std::move(left_out);
    }
  };
  for (std::size_t i = 0; i < source.size(); ++i) {
    for (std::size_t j = wrong == 1 ? source.size() : i + 1; wrong == 2 && j < source.size(); ++j) {
      consider({i, j});
    }
    if (wrong == 1) {
      consider({i});
    }
  }
  return best;
}

// Three points that determine a pose well: the two farthest from each other, and the one farthest from their line.
std::array<std::size_t, 3> wide_triple(const PointList &points) {
  std::array<std::size_t, 3> out{};
  double largest = -1.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t j = i + 1; j < points.size(); ++j) {
      if (const double d = (points[i] - points[j]).norm(); d > largest) {
        largest = d;
        out = {i, j, 0};
      }
    }
  }
  const Vector3d line = (points[out[1]] - points[out[0]]).normalized();
  largest = -1.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (const double d = (points[i] - points[out[0]]).cross(line).norm(); d > largest) {
      largest = d;
      out[2] = i;
    }
  }
  return out;
}

// Each source point's nearest target point that is not taken yet, the closest pairs first.
std::vector<std::size_t> assign(const PointList &moved, const PointList &target) {
  struct Candidate {
    double squared;
    std::size_t from, to;
  };
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    for (std::size_t j = 0; j < target.size(); ++j) {
      candidates.push_back({(moved[i] - target[j]).squaredNorm(), i, j});
    }
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate &a, const Candidate &b) { return a.squared < b.squared; });
  constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> out(moved.size(), kNone);
  std::vector<bool> taken(target.size(), false);
  for (const Candidate &candidate : candidates) {
    if (out[candidate.from] == kNone && !taken[candidate.to]) {
      out[candidate.from] = candidate.to;
      taken[candidate.to] = true;
    }
  }
  return out;
}

// Every triple of target points with the same distances as one triple of source points proposes an order.
std::optional<Explanation> reordered(const PointList &source, const PointList &target, double limit_mm) {
  const std::array<std::size_t, 3> triple = wide_triple(source);
  const double tolerance = 4.0 * limit_mm;
  const auto fits = [&](std::size_t a, std::size_t b, std::size_t i, std::size_t j) {
    return std::abs((source[triple[a]] - source[triple[b]]).norm() - (target[i] - target[j]).norm()) < tolerance;
  };
  Explanation best{.kind = Kind::kReordered, .rms_mm = kInfinity, .indices = {}};
  const auto consider = [&](std::size_t i, std::size_t j, std::size_t k) {
    const auto T = fit_rigid(std::array{source[triple[0]], source[triple[1]], source[triple[2]]},
                             std::array{target[i], target[j], target[k]});
    if (!T) {
      return;
    }
    PointList moved;
    for (const Vector3d &point : source) {
      moved.push_back(*T * point);
    }
    const std::vector<std::size_t> order = assign(moved, target);
    PointList in_order;
    for (const std::size_t to : order) {
      in_order.push_back(target[to]);
    }
    if (const double rms = fit_lists(source, in_order).rms(); rms < best.rms_mm) {
      best.rms_mm = rms;
      best.indices = order;
    }
  };
  for (std::size_t i = 0; i < target.size(); ++i) {
    for (std::size_t j = 0; j < target.size(); ++j) {
      for (std::size_t k = 0; i != j && fits(0, 1, i, j) && k < target.size(); ++k) {
        if (k != i && k != j && fits(0, 2, i, k) && fits(1, 2, j, k)) {
          consider(i, j, k);
        }
      }
    }
  }
  const bool same = std::is_sorted(best.indices.begin(), best.indices.end());
  return same ? std::nullopt : std::optional(best);
}

} // namespace

bool are_coplanar(std::span<const Vector3d> points_mm) noexcept { return spread_mm(points_mm)[2] < kFlat_mm; }

std::vector<Explanation> explain(std::span<const Vector3d> source_mm, std::span<const Vector3d> target_mm,
                                 double limit_mm) {
  const PointList source(source_mm.begin(), source_mm.end());
  const PointList target(target_mm.begin(), target_mm.end());
  const std::size_t count = source.size();
  std::vector<Explanation> out;
  if (count < 4) {
    return out;
  }
  const double rms = fit_lists(source, target).rms();
  if (!(rms > kExact_mm)) {
    return out;
  }
  const auto keep = [&](std::optional<Explanation> relation) {
    if (relation && relation->rms_mm <= limit_mm && relation->rms_mm < rms / 3.0) {
      out.push_back(std::move(*relation));
    }
  };
  keep(mirrored(source, target));
  keep(scaled(source, target));
  if (count <= kMaxReordered) {
    keep(reordered(source, target, limit_mm));
  }
  if (count > 4) {
    keep(best_without(source, target, 1));
  }
  const bool one_is_wrong = !out.empty() && out.back().kind == Kind::kWrongPairs;
  if (!one_is_wrong && count > 6 && count <= kMaxTwoWrong) {
    keep(best_without(source, target, 2));
  }
  std::sort(out.begin(), out.end(), [](const Explanation &a, const Explanation &b) { return a.rms_mm < b.rms_mm; });
  return out;
}

std::optional<OddPair> find_odd_pair(std::span<const Vector3d> source_mm, std::span<const Vector3d> target_mm,
                                     double min_distance_mm, double false_alarm) {
  const PointList source(source_mm.begin(), source_mm.end());
  const PointList target(target_mm.begin(), target_mm.end());
  if (source.size() < 5) {
    return std::nullopt;
  }
  const LeastSquares all = fit_lists(source, target);
  const Explanation rest = best_without(source, target, 1);
  const std::size_t odd = rest.indices.empty() ? source.size() : rest.indices.front();
  if (!all.T || odd == source.size()) {
    return std::nullopt;
  }
  const auto left = static_cast<double>(source.size() - 1);
  const double squares = left * rest.rms_mm * rest.rms_mm;
  const double dof = 3.0 * left - 6.0;
  // The lower bound gives exact copies a result.
  const double ratio = (all.squares - squares) / 3.0 / std::max(squares / dof, 1e-12);
  const LeastSquares others = fit_lists(without(source, rest.indices), without(target, rest.indices));
  const double distance = (*others.T * source[odd] - target[odd]).norm();
  const bool by_chance = uncertainty::f_survival(ratio, 3.0, dof) * (left + 1.0) > false_alarm;
  return by_chance || distance <= min_distance_mm ? std::nullopt : std::optional(OddPair{odd, distance});
}

} // namespace bregma::registration
