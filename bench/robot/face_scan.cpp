#include "bench/robot/face_scan.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "drivers/sim/random.hpp"

namespace bregma::bench {

namespace {

constexpr double kReadings_s = 1000.0;
constexpr double kLowest_mm = 6.0;    // points below are the table's
constexpr double kMaxSlope_rad = 0.6; // 34 degrees
constexpr double kMissingFraction = 0.02;

Eigen::Isometry3d lying_pose(const surface::TriangleMesh &shell, std::uint64_t seed) {
  sim::Random random(seed, "place of the face");
  constexpr double kTilt_rad = 0.12;
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.rotate(Eigen::AngleAxisd(random.uniform(-std::numbers::pi, std::numbers::pi), Eigen::Vector3d::UnitZ()));
  out.rotate(Eigen::AngleAxisd(random.uniform(0.0, kTilt_rad), random.direction()));
  out.rotate(Eigen::AngleAxisd(0.5 * std::numbers::pi, Eigen::Vector3d::UnitX())); // anterior is up
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d &v : shell.vertices_mm) {
    box.extend(out * v);
  }
  out.pretranslate(Eigen::Vector3d(450.0, 0.0, 0.0) -
                   Eigen::Vector3d(box.center().x(), box.center().y(), box.min().z()));
  return out;
}

surface::TriangleMesh moved(surface::TriangleMesh mesh, const Eigen::Isometry3d &pose) {
  for (Eigen::Vector3d &v : mesh.vertices_mm) {
    v = pose * v;
  }
  return mesh;
}

// The sensor's place along the raster, for times that do not decrease.
class Raster {
public:
  Raster(const sim::SurfaceUnderBeam &surface, const ScanPlan &plan)
      : low_(surface.low_mm()), width_(surface.high_mm().x() - low_.x()), plan_(plan) {
    const double height = surface.high_mm().y() - low_.y();
    lines_ = static_cast<int>(height / plan.line_mm) + 1;
    first_y_ = low_.y() + 0.5 * (height - plan.line_mm * (lines_ - 1));
  }
  [[nodiscard]] double length_mm() const { return lines_ * width_ + (lines_ - 1) * plan_.line_mm; }
  [[nodiscard]] Eigen::Vector2d at(double s_mm) const {
    const double period = width_ + plan_.line_mm;
    const int line = std::clamp(static_cast<int>(s_mm / period), 0, lines_ - 1);
    const double along = s_mm - line * period;
    const double x = std::clamp(along, 0.0, width_);
    const double y = first_y_ + line * plan_.line_mm + std::max(0.0, along - width_);
    return {low_.x() + (line % 2 == 0 ? x : width_ - x), y};
  }

private:
  Eigen::Vector3d low_;
  double width_;
  ScanPlan plan_;
  int lines_ = 0;
  double first_y_ = 0.0;
};

} // namespace

ScanPlan ScanPlan::of_points(double count, double area_mm2, double speed_mm_s) {
  ScanPlan out;
  out.line_mm = out.point_mm = std::sqrt(area_mm2 / count);
  out.speed_mm_s = speed_mm_s;
  return out;
}

PlacedFace::PlacedFace(const surface::TriangleMesh &shell_ras, std::uint64_t seed)
    : T_robot_image_(lying_pose(shell_ras, seed)), surface_(moved(shell_ras, T_robot_image_)) {}

double PlacedFace::area_mm2() const {
  constexpr double kStep_mm = 2.0;
  double out = 0.0;
  for (double y = surface_.low_mm().y(); y < surface_.high_mm().y(); y += kStep_mm) {
    for (double x = surface_.low_mm().x(); x < surface_.high_mm().x(); x += kStep_mm) {
      out += surface_.top(x, y) ? kStep_mm * kStep_mm : 0.0;
    }
  }
  return out;
}

ScannedFace scan_face(const PlacedFace &face, const ScanPlan &plan, const range::RangeCurve &curve, double bias_mm,
                      std::uint64_t seed) {
  const Raster raster(face.surface(), plan);
  const auto place = [&](std::int64_t time_ns) {
    return raster.at(1e-9 * static_cast<double>(time_ns) * plan.speed_mm_s);
  };
  sim::SharpSensor sensor(
      {},
      [&](std::int64_t time_ns) {
        const Eigen::Vector2d at = place(time_ns);
        return face.surface().target(at.x(), at.y(), kScanHeight_mm + bias_mm);
      },
      seed);
  sim::Random missing(seed, "missing readings");
  ScannedFace out;
  out.seconds = raster.length_mm() / plan.speed_mm_s;
  std::vector<range::ScanRecord> records;
  const auto count = static_cast<std::int64_t>(out.seconds * kReadings_s);
  records.reserve(static_cast<std::size_t>(count));
  for (std::int64_t i = 0; i < count; ++i) {
    const std::int64_t time_ns = i * 1'000'000;
    const Eigen::Vector2d at = place(time_ns);
    const double volts = sensor.read_volts(time_ns, true);
    records.push_back({at.x(), at.y(), missing.uniform(0.0, 1.0) < kMissingFraction ? std::nan("") : volts});
  }
  range::ScanOptions options;
  options.chain = plan.chain;
  options.chain.every =
      std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(kReadings_s * plan.point_mm / plan.speed_mm_s)));
  options.chain.raw.sensor_delay_ns = kSensorDelay_ns;
  options.curve = curve;
  options.height_mm = kScanHeight_mm;
  options.near_mm = kCurveFrom_mm - 2.0;
  options.lowest_mm = kLowest_mm;
  options.max_slope_rad = kMaxSlope_rad;
  options.at_newest = plan.at_newest;
  out.scan = range::surface_points(records, options);
  std::size_t on_face = 0;
  double squares = 0.0;
  for (const Eigen::Vector3d &p : out.scan.points_mm) {
    if (const auto top = face.surface().top(p.x(), p.y())) {
      const double error = p.z() - top->z_mm;
      out.bias_mm += error;
      squares += error * error;
      ++on_face;
    }
  }
  if (on_face > 0) {
    out.bias_mm /= static_cast<double>(on_face);
    out.rms_mm = std::sqrt(squares / static_cast<double>(on_face));
  }
  return out;
}

std::vector<range::CalibrationPoint> calibration_readings(double from_mm, double to_mm, double step_mm,
                                                          std::uint64_t seed) {
  std::vector<range::CalibrationPoint> out;
  for (double mm = from_mm; mm <= to_mm; mm += step_mm) {
    sim::SharpSensor sensor(
        {},
        [mm](std::int64_t) {
          return sim::BeamTarget{mm, 0.0, std::nan("")};
        },
        seed + static_cast<std::uint64_t>(mm));
    double sum = 0.0;
    constexpr int kReadings = 1000;
    for (int i = 0; i < kReadings; ++i) {
      sum += sensor.read_volts(std::int64_t{i} * 1'000'000, false) / kReadings;
    }
    out.push_back({sum, mm});
  }
  return out;
}

} // namespace bregma::bench
