#include "bench/accuracy/table1_peers.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <numbers>
#include <numeric>
#include <queue>

#include <Eigen/Dense>

namespace bregma::bench {

namespace {

constexpr double kGrid_mm = 2.5;
constexpr double kMargin_mm = 70.0;
constexpr double kTolerance_mm = 1e-16;

// CPU time of this thread: a limit in it means the same on a busy machine.
double cpu_s() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

Vector3d centroid_of(std::span<const Vector3d> points) {
  return std::accumulate(points.begin(), points.end(), Vector3d(Vector3d::Zero())) / static_cast<double>(points.size());
}

// Rotation vector and translation of a pose in its region; outside of the region it is brought back to the border.
using Parameters = geometry::Vector6d;
Parameters within(Parameters p, const SearchRegion &region) {
  const double angle = p.head<3>().norm();
  if (angle > region.angle_rad) {
    p.head<3>() *= region.angle_rad / angle;
  }
  p.tail<3>() = p.tail<3>().cwiseMax(-region.reach_mm).cwiseMin(region.reach_mm);
  return p;
}
PairedPose pose_of(const Parameters &p, const SearchRegion &region, const Vector3d &from_mm, const Vector3d &to_mm) {
  const Eigen::Quaterniond turn = geometry::rotation_exp(p.head<3>()) * region.rotation;
  return {turn, to_mm + p.tail<3>() - turn * from_mm};
}
Parameters random_in(const SearchRegion &region, std::mt19937 &rng) {
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  Vector3d turn;
  do {
    turn = Vector3d(unit(rng), unit(rng), unit(rng));
  } while (turn.norm() > 1.0);
  Parameters out;
  out << region.angle_rad * turn, region.reach_mm * Vector3d(unit(rng), unit(rng), unit(rng));
  return out;
}

} // namespace

FacePeers::FacePeers(std::vector<Vector3d> cloud_mm, const PeerOptions &options)
    : points_(std::move(cloud_mm)), cloud_(points_), options_(options), centroid_(centroid_of(points_)) {
  Vector3d high = points_.front();
  grid_low_ = high;
  for (const Vector3d &p : points_) {
    grid_low_ = grid_low_.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  grid_low_.array() -= kMargin_mm;
  grid_size_ =
      ((high - grid_low_).array() + kMargin_mm).matrix().cwiseQuotient(Vector3d::Constant(kGrid_mm)).cast<int>();
  grid_size_.array() += 1;
  grid_.reserve(static_cast<std::size_t>(grid_size_.cast<long>().prod()));
  for (int k = 0; k < grid_size_.z(); ++k) {
    for (int j = 0; j < grid_size_.y(); ++j) {
      for (int i = 0; i < grid_size_.x(); ++i) {
        const Vector3d at = grid_low_ + kGrid_mm * Vector3d(i, j, k);
        grid_.push_back(static_cast<float>((cloud_.closest(at).point_mm - at).norm()));
      }
    }
  }
}

double FacePeers::distance_mm(const Vector3d &p) const {
  const Vector3d cell = (p - grid_low_) / kGrid_mm;
  const Eigen::Vector3i nearest = (cell.array() + 0.5)
                                      .floor()
                                      .matrix()
                                      .cwiseMax(0.0)
                                      .cwiseMin((grid_size_.array() - 1).matrix().cast<double>())
                                      .cast<int>();
  const auto index = (static_cast<std::size_t>(nearest.z()) * static_cast<std::size_t>(grid_size_.y()) +
                      static_cast<std::size_t>(nearest.y())) *
                         static_cast<std::size_t>(grid_size_.x()) +
                     static_cast<std::size_t>(nearest.x());
  // Within half a cell the grid's value holds, as in Go-ICP; beyond the grid the way to it is added.
  const double beyond = (kGrid_mm * (cell - nearest.cast<double>())).norm();
  return static_cast<double>(grid_[index]) + (beyond > kGrid_mm ? beyond : 0.0);
}

double FacePeers::mean_square_mm2(std::span<const Vector3d> samples_mm, const PairedPose &pose) const {
  double sum = 0.0;
  for (const Vector3d &s : samples_mm) {
    const double d = distance_mm(pose * s);
    sum += d * d;
  }
  return sum / static_cast<double>(samples_mm.size());
}

PairedPose FacePeers::start(std::span<const Vector3d> samples_mm, const SearchRegion &region) const {
  return pose_of(Parameters::Zero(), region, centroid_of(samples_mm), centroid_);
}

PairedPose FacePeers::icp(std::span<const Vector3d> samples_mm, PairedPose start) const {
  const Vector3d middle = centroid_of(samples_mm);
  double before = std::numeric_limits<double>::infinity();
  for (int i = 0; i < options_.icp_iterations; ++i) {
    Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();
    Vector3d matched = Vector3d::Zero();
    double squares = 0.0;
    for (const Vector3d &s : samples_mm) {
      const Vector3d moved = start * s;
      const Vector3d nearest = cloud_.closest(moved).point_mm;
      squares += (nearest - moved).squaredNorm();
      matched += nearest;
      cross += nearest * (s - middle).transpose();
    }
    const double rms = std::sqrt(squares / static_cast<double>(samples_mm.size()));
    if (!(before - rms > kTolerance_mm)) {
      break;
    }
    before = rms;
    matched /= static_cast<double>(samples_mm.size());
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
    flip(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
    const Eigen::Quaterniond turn(Eigen::Matrix3d(svd.matrixU() * flip * svd.matrixV().transpose()));
    start = PairedPose(turn, matched - turn * middle);
  }
  return start;
}

PairedPose FacePeers::anneal(std::span<const Vector3d> samples_mm, const SearchRegion &region,
                             std::mt19937 &rng) const {
  const Vector3d from = centroid_of(samples_mm);
  const auto cost = [&](const Parameters &p) {
    return mean_square_mm2(samples_mm, pose_of(p, region, from, centroid_));
  };
  constexpr double kHot_mm2 = 300.0;
  constexpr double kCold_mm2 = 0.03;
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  Parameters now = Parameters::Zero();
  double now_cost = cost(now);
  Parameters best = now;
  double best_cost = now_cost;
  for (int i = 0; i < options_.evaluations; ++i) {
    const double done = static_cast<double>(i) / options_.evaluations;
    const double temperature = kHot_mm2 * std::pow(kCold_mm2 / kHot_mm2, done);
    const double step = std::pow(temperature / kHot_mm2, 0.4); // of the region
    Parameters next = now;
    for (Eigen::Index k = 0; k < 6; ++k) {
      next[k] += 0.5 * step * (k < 3 ? region.angle_rad : region.reach_mm) * normal(rng);
    }
    next = within(next, region);
    const double next_cost = cost(next);
    if (next_cost < now_cost || unit(rng) < std::exp((now_cost - next_cost) / temperature)) {
      now = next;
      now_cost = next_cost;
    }
    if (now_cost < best_cost) {
      best = now;
      best_cost = now_cost;
    }
  }
  return pose_of(best, region, from, centroid_);
}

PairedPose FacePeers::evolve(std::span<const Vector3d> samples_mm, const SearchRegion &region,
                             std::mt19937 &rng) const {
  constexpr std::size_t kPopulation = 100;
  constexpr std::size_t kElite = 5;
  struct Individual {
    Parameters genes;
    double cost = 0.0;
  };
  const Vector3d from = centroid_of(samples_mm);
  const auto made = [&](const Parameters &genes) {
    return Individual{genes, mean_square_mm2(samples_mm, pose_of(genes, region, from, centroid_))};
  };
  std::vector<Individual> population;
  for (std::size_t i = 0; i < kPopulation; ++i) {
    population.push_back(made(random_in(region, rng)));
  }
  const auto generations = static_cast<int>(static_cast<std::size_t>(options_.evaluations) / kPopulation) - 1;
  std::uniform_int_distribution<std::size_t> pick(0, kPopulation - 1);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::normal_distribution<double> normal;
  const auto parent = [&]() -> const Individual & {
    const Individual &a = population[pick(rng)];
    const Individual &b = population[pick(rng)];
    return a.cost < b.cost ? a : b;
  };
  for (int g = 0; g < generations; ++g) {
    std::sort(population.begin(), population.end(), [](const auto &a, const auto &b) { return a.cost < b.cost; });
    std::vector<Individual> next(population.begin(), population.begin() + kElite);
    const double mutation = 0.2 * std::pow(0.01, static_cast<double>(g) / generations);
    while (next.size() < kPopulation) {
      const Parameters &a = parent().genes;
      const Parameters &b = parent().genes;
      Parameters child;
      for (Eigen::Index k = 0; k < 6; ++k) {
        child[k] = a[k] + (1.5 * unit(rng) - 0.25) * (b[k] - a[k]);
        if (unit(rng) < 0.3) {
          child[k] += mutation * (k < 3 ? region.angle_rad : region.reach_mm) * normal(rng);
        }
      }
      next.push_back(made(within(child, region)));
    }
    population = std::move(next);
  }
  const auto best = std::min_element(population.begin(), population.end(),
                                     [](const auto &a, const auto &b) { return a.cost < b.cost; });
  return pose_of(best->genes, region, from, centroid_);
}

// Algorithms 1 and 2 of [Yang 2016]. Costs are sums over the samples, mm^2.
struct FacePeers::Branching {
  struct Cube {
    Vector3d middle;
    double half = 0.0;
    double lower = 0.0;
    bool operator<(const Cube &other) const { return lower > other.lower; } // the lowest bound first
  };
  struct Inner {
    double cost = 0.0; // the lowest sum, or a bound of it
    Vector3d translation = Vector3d::Zero();
  };

  const FacePeers &peers;
  const SearchRegion &region;
  std::vector<Vector3d> samples; // about their centroid
  double until_s = 0.0;          // of cpu_s()
  double gap = 0.0;

  [[nodiscard]] bool late() const { return cpu_s() > until_s; }

  // Best translation for rotated samples whose distances are lowered by `slack`; stops at costs above `bound`.
  [[nodiscard]] Inner translate(const std::vector<Vector3d> &rotated, const std::vector<double> &slack,
                                double bound) const {
    Inner best{bound, Vector3d::Zero()};
    std::priority_queue<Cube> queue;
    queue.push({Vector3d::Zero(), region.reach_mm, 0.0});
    std::vector<double> distances(rotated.size());
    while (!queue.empty()) {
      const Cube cube = queue.top();
      queue.pop();
      if (best.cost - cube.lower < gap || late()) {
        break;
      }
      for (int octant = 0; octant < 8; ++octant) {
        Cube child{cube.middle, 0.5 * cube.half, 0.0};
        for (int axis = 0; axis < 3; ++axis) {
          child.middle[axis] += (octant >> axis & 1) != 0 ? child.half : -child.half;
        }
        const double reach = std::numbers::sqrt3 * child.half;
        double upper = 0.0;
        for (std::size_t i = 0; i < rotated.size(); ++i) {
          const double d = std::max(0.0, peers.distance_mm(rotated[i] + peers.centroid_ + child.middle) - slack[i]);
          upper += d * d;
          const double least = std::max(0.0, d - reach);
          child.lower += least * least;
        }
        if (upper < best.cost) {
          best = {upper, child.middle};
        }
        if (child.lower < best.cost) {
          queue.push(child);
        }
      }
    }
    return best;
  }
};

GoIcpResult FacePeers::go_icp(std::span<const Vector3d> samples_mm, const SearchRegion &region) const {
  const Vector3d from = centroid_of(samples_mm);
  const auto count = static_cast<double>(samples_mm.size());
  Branching search{*this, region, {}, cpu_s() + options_.go_icp_seconds, options_.go_icp_gap_mm2 * count};
  for (const Vector3d &s : samples_mm) {
    search.samples.push_back(region.rotation * (s - from));
  }
  GoIcpResult out;
  out.T_target_source = icp(samples_mm, start(samples_mm, region));
  double best = count * mean_square_mm2(samples_mm, out.T_target_source);
  std::priority_queue<Branching::Cube> queue;
  queue.push({Vector3d::Zero(), region.angle_rad, 0.0});
  const std::vector<double> none(samples_mm.size(), 0.0);
  std::vector<double> slack(samples_mm.size());
  std::vector<Vector3d> rotated(samples_mm.size());
  while (!queue.empty()) {
    const Branching::Cube cube = queue.top();
    queue.pop();
    if (best - cube.lower <= search.gap) {
      out.bounded = true;
      return out;
    }
    if (search.late()) {
      return out;
    }
    for (int octant = 0; octant < 8; ++octant) {
      Branching::Cube child{cube.middle, 0.5 * cube.half, 0.0};
      for (int axis = 0; axis < 3; ++axis) {
        child.middle[axis] += (octant >> axis & 1) != 0 ? child.half : -child.half;
      }
      const double reach = std::numbers::sqrt3 * child.half;
      if (child.middle.norm() - reach > region.angle_rad) {
        continue; // outside of the ball of rotations
      }
      const Eigen::Quaterniond turn = geometry::rotation_exp(child.middle);
      for (std::size_t i = 0; i < rotated.size(); ++i) {
        rotated[i] = turn * search.samples[i];
        slack[i] = 2.0 * std::sin(0.5 * std::min(reach, std::numbers::pi)) * search.samples[i].norm();
      }
      const Branching::Inner upper = search.translate(rotated, none, best);
      if (upper.cost < best) {
        Parameters p;
        p << child.middle, upper.translation;
        const PairedPose pose = pose_of(p, region, from, centroid_);
        const PairedPose refined = icp(samples_mm, pose);
        const double cost = count * mean_square_mm2(samples_mm, refined);
        out.T_target_source = cost < upper.cost ? refined : pose;
        best = std::min(cost, upper.cost);
      }
      child.lower = search.translate(rotated, slack, best).cost;
      // The inner search stops within the gap of its lowest bound.
      child.lower = std::max(cube.lower, child.lower - search.gap);
      if (child.lower < best) {
        queue.push(child);
      }
    }
  }
  out.bounded = true;
  return out;
}

} // namespace bregma::bench
