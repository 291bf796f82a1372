#include "tests/component/robot/robot_case.hpp"

#include <fstream>
#include <optional>
#include <random>
#include <stdexcept>
#include <vector>

#include <nlohmann/json.hpp>

#include "algorithms/calibration/hand_eye.hpp"
#include "algorithms/range/power_law.hpp"
#include "algorithms/surface/surface_model.hpp"
#include "drivers/range/range_sensor.hpp"
#include "drivers/sim/range/sharp_sensor.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/robot/arms.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::test {

namespace {

using geometry::Vector3d;
using nlohmann::json;

constexpr double kSigmaBeam_mm = 0.15, kSigmaBeam_rad = 0.0015, kSigmaTip_mm = 0.1;
constexpr double kCurveFrom_mm = 150.0, kCurveTo_mm = 235.0;

json rows_of(const Eigen::MatrixXd &matrix) {
  json out = json::array();
  for (Eigen::Index row = 0; row < matrix.rows(); ++row) {
    out.push_back(std::vector<double>());
    for (Eigen::Index column = 0; column < matrix.cols(); ++column) {
      out.back().push_back(matrix(row, column));
    }
  }
  return out;
}

json list_of(const Vector3d &v) { return {v.x(), v.y(), v.z()}; }

// A relief of a few millimetres on the smooth head.
surface::TriangleMesh face(std::uint64_t seed) {
  surface::TriangleMesh out = make_head(4);
  std::mt19937 rng(static_cast<unsigned>(seed));
  const SmoothField relief(rng, 22.0);
  for (Vector3d &vertex : out.vertices_mm) {
    vertex += 4.0 * relief(vertex) * (vertex - kHeadCentre).normalized();
  }
  return out;
}

// A tracker that looks at the place of the head, from above and from a side of the arm.
RobotCase::T_BaseTracker tracker_place() {
  const Vector3d at = mz07f().forward(arm_settings().start) * Vector3d(0.0, 0.0, 240.0);
  const Vector3d from = at + Vector3d(200.0, -1200.0, 900.0);
  Eigen::Matrix3d axes; // z points away from the camera
  axes.col(2) = (at - from).normalized();
  axes.col(0) = axes.col(2).cross(Vector3d::UnitZ()).normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return {axes, from};
}

casefile::ToolModel marker_body() {
  casefile::ToolModel out{.name = "Marker", .role = casefile::ToolRole::kPointer, .markers_mm = {}};
  out.markers_mm = {{0, 0, 0}, {90, 10, 0}, {15, 75, 10}, {80, 80, -10}, {45, 30, 40}};
  return out;
}

} // namespace

sim::ArmSettings arm_settings() {
  sim::ArmSettings out;
  out.start << 0.0, 1.4, 0.0, 0.1, -1.1, 0.0;
  return out;
}

RobotCase::RobotCase(std::uint64_t seed, bool beside_tracker, bool flange_body, const RangeKnowledge &known) {
  std::mt19937 rng(static_cast<unsigned>(seed) + 1);
  origin_mm_ = Vector3d(12.0, -8.0, 60.0) + normal_vector(rng, kSigmaBeam_mm);
  direction_ =
      (geometry::rotation_exp(Vector3d(0.015, -0.01, 0.0) + normal_vector(rng, kSigmaBeam_rad)) * Vector3d::UnitZ())
          .normalized();
  tip_mm_ = Vector3d(-5.0, 3.0, 150.0) + normal_vector(rng, kSigmaTip_mm);
  T_base_tracker_ = tracker_place();
  T_flange_body_ = {geometry::rotation_exp(Vector3d(0.3, -0.2, 0.5)), Vector3d(60.0, 40.0, -20.0)};
  case_ = sim::test::make_case();
  case_.folder = folder_.path();
  case_.id = "robot";
  case_.scalp.mesh = face(seed);
  const surface::SurfaceModel skin(case_.scalp.mesh);
  for (auto *points : {&case_.fiducials, &case_.landmarks}) {
    for (casefile::NamedPoint &point : *points) {
      point.position_mm = skin.closest(point.position_mm).point_mm;
    }
  }
  // The arm faces the face: a way that it reaches.
  case_.trajectories.push_back(
      {"Frontal", skin.closest(on_head(Vector3d(0.2, 0.9, 0.35))).point_mm, case_.targets.front().position_mm});
  if (beside_tracker) {
    case_.tools = {*case_.reference(), marker_body()};
    write_hand_eye(seed);
  } else {
    case_.tools.clear();
  }
  case_.image = folder_.path() / "image.nii.gz";
  std::ofstream(case_.image) << "only its name matters to the daemon\n";
  write_equipment(known);
  if (beside_tracker) {
    std::ofstream(folder_.path() / "robot.toml", std::ios::app)
        << "[hand_eye]\nfile = \"hand_eye.json\"\ntracker = \"Tracker\"\n"
        << (flange_body ? "flange_body = \"Marker\"\n" : "");
  }
  case_.robot = casefile::CaseRobot{"Robot", folder_.path() / "robot.toml", {}};
  case_.robot->equipment.hand_eye =
      beside_tracker ? std::optional<casefile::HandEyeModel>(std::in_place) : std::nullopt;
  if (const auto saved = casefile::save_case(case_); !saved) {
    throw std::runtime_error(saved.error().message);
  }
  auto loaded = casefile::load_case(folder_.path());
  if (!loaded) {
    throw std::runtime_error(loaded.error().message);
  }
  case_ = *loaded;
}

void RobotCase::write_equipment(const RangeKnowledge &known) const {
  std::ofstream equipment(folder_.path() / "robot.toml");
  equipment << "arm = \"" BREGMA_SOURCE_DIR "/robots/mz07f.toml\"\n"
            << "[[tools]]\nname = \"Pointer\"\ntip_mm = [-5, 3, 150]\nsigma_mm = 0.1\nsigma_deg = 0.2\n"
               "[[tools]]\nname = \"Drill\"\ntip_mm = [0, 0, 100]\nsigma_mm = 0.1\n";
  for (const char *name : {"Range", "Spare"}) {
    equipment << "[[sensors]]\nname = \"" << name
              << "\"\nbeam = \"beam.json\"\ncurve = \"curve.json\"\nwindow = 100\ndelay_ms = 38.3\nsigma_mm = 0.8\n"
                 "near_mm = 150\nfar_mm = 240\nexcess_mm = "
              << known.excess_mm << '\n';
  }
  equipment.close();
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(6, 6);
  covariance.diagonal() << Eigen::Vector3d::Constant(kSigmaBeam_rad * kSigmaBeam_rad),
      Eigen::Vector3d::Constant(kSigmaBeam_mm * kSigmaBeam_mm);
  const Vector3d direction = geometry::rotation_exp(Vector3d(0.015, -0.01, 0.0)) * Vector3d::UnitZ();
  std::ofstream(folder_.path() / "beam.json") << json{{"accepted", true},
                                                      {"text", "accepted"},
                                                      {"origin_mm", {12.0, -8.0, 60.0}},
                                                      {"direction", list_of(direction)},
                                                      {"covariance", rows_of(covariance)}};
  // What the driver states for known distances: the data sheet's curve through the driver's power law.
  const range::PowerLaw driver = range::PowerCurve{}.law;
  std::vector<range::CalibrationPoint> points;
  for (double d = kCurveFrom_mm; d <= kCurveTo_mm; d += 1.0) {
    points.push_back({driver.distance_mm(sim::sharp_volts(d)), d});
  }
  const range::PowerLawFit fit = range::fit_power_law(points);
  if (!fit.accepted()) {
    throw std::runtime_error("the curve of the simulated sensor: " + fit.text);
  }
  json curve = {{"accepted", true},
                {"text", fit.text},
                {"scale_mm", fit.law.scale_mm},
                {"exponent", fit.law.exponent},
                {"covariance", rows_of(fit.covariance)},
                {"rms_mm", fit.rms_mm}};
  if (known.corrected) {
    curve["corrected_rms_mm"] = fit.corrected_rms_mm;
    for (const range::CurveCorrection &c : fit.corrections) {
      curve["corrections"].push_back({{"reading", c.reading}, {"add_mm", c.add_mm}});
    }
  }
  std::ofstream(folder_.path() / "curve.json") << curve;
}

// As `bregma calibrate hand-eye` does, from poses with the errors that it assumes.
void RobotCase::write_hand_eye(std::uint64_t seed) const {
  std::mt19937 rng(static_cast<unsigned>(seed) + 11);
  const robot::FlangePose start = mz07f().forward(arm_settings().start);
  const calibration::HandEyeOptions options;
  const auto measured = [&](const auto &T, const calibration::PoseNoise &noise) {
    const Eigen::Quaterniond turn = geometry::rotation_exp(normal_vector(rng, noise.rotation_rad));
    return calibration::HandEyePose(turn * T.rotation(), T.translation() + normal_vector(rng, noise.position_mm));
  };
  std::vector<calibration::HandEyePair> pairs;
  for (int i = 0; i < 20; ++i) {
    const robot::FlangePose A(start.rotation() * geometry::rotation_exp(normal_vector(rng, 0.35)),
                              start.translation() + normal_vector(rng, 80.0));
    const auto B = T_base_tracker_.inverse() * A * T_flange_body_;
    pairs.push_back({measured(A, options.robot), measured(B, options.tracker)});
  }
  const calibration::HandEyeResult result = calibration::calibrate_hand_eye(pairs, options);
  if (!result.accepted()) {
    throw std::runtime_error("hand-eye: " + result.text);
  }
  std::ofstream(folder_.path() / "hand_eye.json") << json{{"accepted", true},
                                                          {"text", result.text},
                                                          {"X", rows_of(result.X.matrix())},
                                                          {"Y", rows_of(result.Y.matrix())},
                                                          {"covariance_joint", rows_of(result.joint)}};
}

} // namespace bregma::test
