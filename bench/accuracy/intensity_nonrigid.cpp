// Nonrigid registration of one head to its bent copy, beside elastix with the same grid.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>

#include "algorithms/intensity/nonrigid_image.hpp"
#include "algorithms/intensity/resolution.hpp"
#include "algorithms/intensity/warp.hpp"
#include "bench/accuracy/intensity_elastix.hpp"
#include "bench/accuracy/intensity_parts.hpp"

namespace bregma::bench {

namespace {

using Eigen::Vector3d;
using intensity::Volume;

constexpr double kSpacing_mm = 2.0;
constexpr double kGrid_mm = 20.0;
constexpr double kLargest_mm = 9.0;

// Six Gaussians of 25 to 35 mm in the brain; no spline of the lattice. The largest displacement is kLargest_mm.
class Bulge {
public:
  Bulge(const std::vector<Vector3d> &brain, std::mt19937_64 &rng) {
    for (Lump &lump : lumps_) {
      const auto at = static_cast<std::size_t>(0.5 * (uniform(rng) + 1.0) * static_cast<double>(brain.size() - 1));
      lump = {brain[at], direction(rng), 30.0 + 5.0 * uniform(rng)};
    }
    double largest = 0.0;
    for (const Vector3d &p : brain) {
      largest = std::max(largest, (*this)(p).norm());
    }
    scale_ = kLargest_mm / largest;
  }
  Vector3d operator()(const Vector3d &p) const {
    Vector3d sum = Vector3d::Zero();
    for (const Lump &lump : lumps_) {
      sum += std::exp(-(p - lump.centre).squaredNorm() / (2.0 * lump.sigma_mm * lump.sigma_mm)) * lump.towards;
    }
    return scale_ * sum;
  }

private:
  struct Lump {
    Vector3d centre, towards;
    double sigma_mm = 0.0;
  };
  std::array<Lump, 6> lumps_;
  double scale_ = 1.0;
};

// A copy in which p + bulge(p) shows what the head shows at p, in other grey values with 4 % of noise.
Volume bent_copy(const Volume &head, const Volume &grid, const Bulge &bulge, std::mt19937_64 &rng,
                 parallel::Team &team) {
  const Volume soft = intensity::smoothed(head, 0.5 * kSpacing_mm, team);
  const auto inverse = [&](const Vector3d &q) {
    Vector3d p = q;
    for (int n = 0; n < 40; ++n) {
      p = q - bulge(p);
    }
    return p;
  };
  Volume out{grid, intensity::warp<3>(grid, soft, soft.voxels, inverse, team)};
  const intensity::GreyRange grey = intensity::grey_range(out.voxels, 0.001);
  for (float &v : out.voxels) {
    const double y = std::isfinite(v) ? static_cast<double>((v - grey.low) / (grey.high - grey.low)) : 0.0;
    v = static_cast<float>(255.0 * ((y < 0.15 ? 0.5 * y : 0.9 * std::sin(2.6 * y)) + 0.04 * normal(rng)));
  }
  return out;
}

std::vector<Vector3d> brain_points(const Volume &labels) {
  constexpr int kStep = 4;
  std::vector<Vector3d> out;
  for (int k = 0; k < labels.size[2]; k += kStep) {
    for (int j = 0; j < labels.size[1]; j += kStep) {
      for (int i = 0; i < labels.size[0]; i += kStep) {
        if (labels.at(i, j, k) > 0.0F) {
          out.push_back(labels.point_mm(Vector3d(i, j, k)));
        }
      }
    }
  }
  return out;
}

struct Residuals {
  double squares = 0.0, count = 0.0, worst_mm = 0.0;
  std::vector<double> all_mm;
  void take(const Vector3d &error) {
    squares += error.squaredNorm();
    count += 1.0;
    all_mm.push_back(error.norm());
  }
  void report_to(Report &report, const std::string &name) {
    report.add(figure(name + " residual, rms", std::sqrt(squares / count), "mm"));
    report.add(figure(name + " residual, 95 %", percentile(all_mm, 0.95), "mm"));
    worst_mm = percentile(all_mm, 1.0);
    report.add(figure(name + " residual, worst", worst_mm, "mm"));
  }
};

} // namespace

void nonrigid_figures(Report &report, const IntensityOptions &options) {
  const Volume head = load_volume(options.colin);
  const std::vector<Vector3d> points = brain_points(load_volume(options.labels));
  parallel::Team team(bench_threads());
  const int runs = options.quick ? 1 : 5;
  report.note(
      "Colin27 at 2 mm and its copy, bent smoothly by up to 9 mm, with other grey values and noise; residuals at " +
      std::to_string(points.size()) + " points of the brain, cells of 20 mm, " + std::to_string(runs) +
      " deformations; both from the true pose");
  std::mt19937_64 rng(83);
  const Volume reference = intensity::shrunk(head, kSpacing_mm, team);
  Residuals before;
  Residuals ours;
  Residuals peer;
  std::vector<double> times_s;
  std::vector<double> peer_times_s;
  double smallest = 1.0;
  int found = 0;
  for (int run = 0; run < runs; ++run) {
    const Bulge bulge(points, rng);
    const Volume floating = bent_copy(head, reference, bulge, rng, team);
    intensity::NonrigidImageOptions how;
    how.measure_options.tail = 0.001;
    how.grid_mm = kGrid_mm;
    const auto began = std::chrono::steady_clock::now();
    const intensity::NonrigidImageResult result = intensity::register_nonrigid(reference, floating, {}, how, team);
    times_s.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count());
    found += result.found ? 1 : 0;
    smallest = std::min(smallest, result.jacobian.smallest);
    const auto other = run_elastix_nonrigid(reference, floating, kGrid_mm, points);
    if (other) {
      peer_times_s.push_back(other->time_s);
    } else {
      report.note("elastix: " + other.error().message);
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
      before.take(bulge(points[i]));
      ours.take(result.field.displacement_mm(points[i]) - bulge(points[i]));
      if (other) {
        peer.take(other->moved_mm[i] - points[i] - bulge(points[i]));
      }
    }
  }
  before.report_to(report, "nonrigid, before,");
  ours.report_to(report, "nonrigid,");
  report.add(at_most("nonrigid, worst residual against one voxel", ours.worst_mm, "mm", kSpacing_mm));
  report.add(at_least("nonrigid, smallest Jacobian", smallest, "", 1e-6));
  report.add(at_least("nonrigid, found", found, "runs", runs));
  report.add(figure("nonrigid, time", percentile(times_s, 0.5), "s"));
  if (!peer_times_s.empty()) {
    peer.report_to(report, "nonrigid, elastix,");
    report.add(figure("nonrigid, elastix, time", percentile(peer_times_s, 0.5), "s"));
  }
}

} // namespace bregma::bench
