// Other fiducials on the same scanner, bodies, fields and hidden errors: active coils, a Z-frame of nine rods, and
// micro-coils that the scanner locates by projections. docs/scanner.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include "algorithms/registration/points/paired_points.hpp"
#include "bench/accuracy/mri_runs.hpp"
#include "drivers/sim/random.hpp"

namespace bregma::bench {

namespace {

using namespace sim::scanner;
using Pose = Rigid3<mri::frame::Base, mri::frame::Device>;

constexpr double kRepetition_s = 0.528; // the paper's, for all scans
constexpr int kProjections = 6;         // three axes, both directions of the read-out
constexpr double kProjection_s = 0.01;
// Of one coordinate of a micro-coil: a peak in a projection of 1.17 mm samples, found to an eighth.
constexpr double kMicroCoil_mm = 0.15;

// ---- Z-frame ----

// Bright spots of a slice, in pixels: connected pixels above half of the signal.
std::vector<Eigen::Vector2d> spots(const mri::Stack &stack, int k, float level) {
  const int columns = stack.size[0], rows = stack.size[1];
  std::vector<char> seen(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), 0);
  const auto flat = [&](int i, int j) {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(i);
  };
  std::vector<Eigen::Vector2d> out;
  std::vector<std::array<int, 2>> open;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      if (seen[flat(i, j)] != 0 || stack.at(i, j, k) < level) {
        continue;
      }
      Eigen::Vector2d sum = Eigen::Vector2d::Zero();
      int pixels = 0;
      seen[flat(i, j)] = 1;
      open.assign(1, {i, j});
      while (!open.empty()) {
        const auto [x, y] = open.back();
        open.pop_back();
        sum += Eigen::Vector2d(x, y);
        ++pixels;
        for (const auto &[dx, dy] : {std::array{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
          const int nx = x + dx, ny = y + dy;
          if (nx >= 0 && ny >= 0 && nx < columns && ny < rows && seen[flat(nx, ny)] == 0 &&
              stack.at(nx, ny, k) >= level) {
            seen[flat(nx, ny)] = 1;
            open.push_back({nx, ny});
          }
        }
      }
      if (pixels >= 4) {
        out.emplace_back(sum / pixels);
      }
    }
  }
  return out;
}

// Centroid of the signal above `floor` around a spot, in pixels.
Eigen::Vector2d centroid(const mri::Stack &stack, int k, Eigen::Vector2d at, float floor) {
  constexpr double kReach_mm = 6.5;
  const double pixel = stack.spacing_mm().x();
  const int reach = static_cast<int>(std::ceil(kReach_mm / pixel));
  for (int round = 0; round < 5; ++round) {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    double weight = 0.0;
    for (int j = static_cast<int>(at.y()) - reach; j <= static_cast<int>(at.y()) + reach + 1; ++j) {
      for (int i = static_cast<int>(at.x()) - reach; i <= static_cast<int>(at.x()) + reach + 1; ++i) {
        const Eigen::Vector2d p(i, j);
        const double inside = std::clamp((kReach_mm - (p - at).norm() * pixel) / 1.5, 0.0, 1.0);
        if (inside > 0.0 && i >= 0 && j >= 0 && i < stack.size[0] && j < stack.size[1]) {
          const double w = inside * static_cast<double>(stack.at(i, j, k) - floor);
          sum += w * p;
          weight += w;
        }
      }
    }
    at = sum / weight;
  }
  return at;
}

struct LineFit {
  Pose pose;
  double fre_mm = 0.0;
};
// Points in Device that lie on the rods in Base: Gauss-Newton from the pose in which the frame is mounted, each point
// on its nearest rod.
std::optional<LineFit> fit_to_rods(const std::vector<Vector3d> &points, const std::vector<Rod> &rods,
                                   const Pose &mounted) {
  LineFit out{mounted, 0.0};
  constexpr double kFar_mm = 12.0; // half the distance between rods, and what the mounting may be off
  for (int round = 0; round < 30; ++round) {
    geometry::Matrix6d normal = geometry::Matrix6d::Zero();
    geometry::Vector6d right = geometry::Vector6d::Zero();
    double squares = 0.0;
    int used = 0;
    for (const Vector3d &point : points) {
      const Vector3d p = out.pose * point;
      Vector3d miss = Vector3d::Constant(1e9);
      Eigen::Matrix3d across = Eigen::Matrix3d::Identity();
      for (const Rod &rod : rods) {
        const Vector3d d = (rod.to_mm - rod.from_mm).normalized();
        const Eigen::Matrix3d projector = Eigen::Matrix3d::Identity() - d * d.transpose();
        const Vector3d to_rod = projector * (p - rod.from_mm);
        if (to_rod.norm() < miss.norm()) {
          miss = to_rod;
          across = projector;
        }
      }
      if (miss.norm() > kFar_mm) {
        continue;
      }
      const geometry::Matrix36d J = across * geometry::point_jacobian(p);
      normal += J.transpose() * J;
      right -= J.transpose() * miss;
      squares += miss.squaredNorm();
      ++used;
    }
    if (used < 30) {
      return std::nullopt;
    }
    out.fre_mm = std::sqrt(squares / used);
    const geometry::Vector6d step = normal.ldlt().solve(right);
    out.pose = Rigid3<mri::frame::Base, mri::frame::Base>(geometry::rotation_exp(Vector3d(step.head<3>())),
                                                          Vector3d(step.tail<3>())) *
               out.pose;
    if (step.norm() < 1e-7) {
      break;
    }
  }
  return out;
}

std::optional<LineFit> z_frame(MriSession &session, std::uint64_t seed, const Pose &mounted, double build_mm) {
  sim::Random build(seed, "z-frame");
  sim::Random noise(seed, "z-frame noise");
  std::vector<Rod> rods = z_frame_design();
  for (Rod &rod : rods) {
    rod.from_mm += build.normal3(build_mm);
    rod.to_mm += build.normal3(build_mm);
  }
  std::vector<Vector3d> fine;
  const BodyPose &T_device_base = session.scanner().truth().T_device_base;
  for (const Rod &rod : rods) {
    for (const double part : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      fine.push_back(T_device_base * Vector3d(rod.from_mm + part * (rod.to_mm - rod.from_mm)));
    }
  }
  const StackPlan plan = plan_of(Plane::kCoronal, Vector3d::Zero(), 50);
  const Acquisition acquisition(session.scanner().field(), small_protocol(50), plan);
  const mri::Stack stack = received(acquisition.clean(ZFrame(rods), T_device_base, fine), nullptr, Vector3d::Zero(),
                                    Appearance{}, seed, noise);
  std::vector<float> sorted = stack.voxels;
  const auto at = [&](double part) {
    const auto n = static_cast<std::ptrdiff_t>(part * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), sorted.begin() + n, sorted.end());
    return sorted[static_cast<std::size_t>(n)];
  };
  const float floor = at(0.5);
  const float level = 0.5F * at(0.995);
  const auto correct = session.options(Images::kOurs, mri::CoilMethod::kMultiSlice).correction;
  std::vector<Vector3d> points;
  for (int k = 0; k < stack.size[2]; ++k) {
    for (const Eigen::Vector2d &spot : spots(stack, k, level)) {
      const Eigen::Vector2d c = centroid(stack, k, spot, floor);
      if (const auto real = correct(stack.point_mm(Vector3d(c.x(), c.y(), k)))) {
        points.push_back(real->position_mm);
      }
    }
  }
  return fit_to_rods(points, z_frame_design(), mounted);
}

// ---- Micro-coils ----

// At the places of these coils. A projection along each axis shows one coordinate, with B0 along that axis; with the
// read-out in both directions B0 cancels.
std::optional<LineFit> micro_coils(MriSession &session, std::uint64_t seed, const std::vector<std::string> &names,
                                   double build_mm) {
  sim::Random build(seed, "micro-coils");
  sim::Random noise(seed, "micro-coil noise");
  const ScannerField &field = session.scanner().field();
  const BodyPose &T_device_base = session.scanner().truth().T_device_base;
  const auto correct = session.options(Images::kOurs, mri::CoilMethod::kMultiSlice).correction;
  std::vector<Vector3d> device, base;
  for (const std::string &name : names) {
    const Vector3d drawn = session.frame().coils[static_cast<std::size_t>(session.frame().find(name))].position_mm;
    const Vector3d real = T_device_base * Vector3d(drawn + build.normal3(build_mm));
    const Vector3d shown = real + field.gradient_mm(real) + noise.normal3(kMicroCoil_mm / std::sqrt(2.0));
    if (const auto point = correct(shown)) {
      device.push_back(point->position_mm);
      base.push_back(drawn);
    }
  }
  const auto T = registration::fit_rigid(device, base);
  if (!T) {
    return std::nullopt;
  }
  LineFit out{T->as<mri::frame::Base, mri::frame::Device>(), 0.0};
  for (std::size_t i = 0; i < device.size(); ++i) {
    out.fre_mm += (out.pose * device[i] - base[i]).squaredNorm() / static_cast<double>(device.size());
  }
  out.fre_mm = std::sqrt(out.fre_mm);
  return out;
}

void add_fit(Study &study, const MriSession &session, const std::optional<LineFit> &fit) {
  ++study.runs;
  if (fit) {
    ++study.found;
    study.fre_mm.push_back(fit->fre_mm);
    study.tre_mm.push_back(
        target_error(session, geometry::UncertainPose<mri::frame::Base, mri::frame::Device>{fit->pose, {}})
            .error_mm.norm());
  }
}

} // namespace

void robot_fiducials(Report &report, const MriBenchOptions &options) {
  const int seeds = seeds_of(options, 20, 1);
  report.note(
      "Fiducials on the same scanner, with the same distortion field, placement and build tolerance (0.2 mm per axis): "
      "8 coils of the mid pillars, a Z-frame of nine rods 140 mm wide in 50 slices of 1.5 mm, 8 and 4 micro-coils at "
      "places of those coils, located in projections of 1.17 mm with both directions of the read-out.");
  Study coils, rods, eight, four;
  Progress progress("fiducials", seeds);
  for (int seed = 1; seed <= seeds; ++seed, progress.step()) {
    const auto number = static_cast<std::uint64_t>(options.first) + static_cast<std::uint64_t>(seed);
    ScannerOptions scanner;
    scanner.fine_groups = {"mid-top", "mid-bottom"};
    MriSession session(scanner, number);
    if (!session.map_field()) {
      continue;
    }
    add_run(coils, session, PillarRun(session, {"mid"}, small_protocol(60), 60, Images::kOurs).result);
    // Mounted upright at the isocentre: what the room knows without a registration.
    Eigen::Matrix3d upright; // of Device from Base
    upright << 1, 0, 0, 0, 0, 1, 0, -1, 0;
    const double build_mm = scanner.errors.build_mm;
    add_fit(rods, session,
            z_frame(session, number, Pose(Eigen::Matrix3d(upright.transpose()), Vector3d::Zero()), build_mm));
    add_fit(eight, session,
            micro_coils(session, number,
                        {"mid-top-1", "mid-top-2", "mid-top-3", "mid-top-4", "mid-bottom-1", "mid-bottom-2",
                         "mid-bottom-3", "mid-bottom-4"},
                        build_mm));
    add_fit(four, session,
            micro_coils(session, number, {"mid-top-1", "mid-top-3", "mid-bottom-2", "mid-bottom-4"}, build_mm));
  }
  const auto add = [&](const std::string &name, Study &study, double seconds) {
    add_study(report, name, study);
    report.add(figure(name + ", TRE, 95 % of runs", percentile(study.tre_mm, 0.95), "mm"));
    report.add(figure(name + ", scan time", seconds, "s"));
  };
  const double stack_s = kRepetition_s * small_protocol(60).matrix;
  add("8 active coils", coils, 4.0 * stack_s); // two positions, background and foreground
  add("Z-frame of nine rods", rods, stack_s);
  add("8 micro-coils", eight, kProjections * kProjection_s);
  add("4 micro-coils", four, kProjections * kProjection_s);
}

} // namespace bregma::bench
