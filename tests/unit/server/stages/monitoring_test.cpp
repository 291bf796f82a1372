// The alarms of the monitoring pipeline over the whole life of a daemon.
#include "server/stages/monitoring/pipeline.hpp"

#include <cmath>
#include <random>
#include <set>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace bregma::server {
namespace {

constexpr int kCases = 200;

class MonitoringTest : public ::testing::Test {
protected:
  // A case whose tools have names of their own.
  void load(int number) { load(number, tests::sample_case("/cases/sample")); }
  void load(int number, casefile::Case a_case) {
    const std::string suffix = std::to_string(number);
    for (casefile::ToolModel &tool : a_case.tools) {
      tool.name += suffix;
    }
    loaded = std::make_unique<LoadedCase>(std::make_shared<const casefile::Case>(std::move(a_case)), 12.0, 100);
    pipeline.handle(CaseChanged{static_cast<std::uint64_t>(number) + 1, loaded.get()});
    RegistrationAccepted accepted{};
    accepted.T_image_reference = {{1.0, 0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
    for (std::size_t i = 0; i < 6; ++i) {
      accepted.covariance[7 * i] = i < 3 ? 1e-6 : 0.04;
    }
    pipeline.handle(MonitoringMessage(accepted));
    pipeline.handle(MonitoringMessage(SessionChanged{bregma_wire_SESSION_NAVIGATING, true}));
  }
  // A touch of the only landmark; error_mm: of the displayed tip.
  void touch(double error_mm) {
    JudgedCheck check{};
    check.error_mm = {error_mm, 0.0, 0.0};
    check.touch_covariance_mm2 = {0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1};
    pipeline.handle(MonitoringMessage(check));
  }
  void run(double milliseconds) {
    for (double passed = 0.0; passed < milliseconds; passed += 100.0) {
      now_ns += 100'000'000;
      pipeline.step({tracking, trackers, sensors, registration, recorder}, now_ns);
      AlarmCondition condition;
      while (events.try_pop(condition)) {
        (condition.active ? raised : cleared).insert(wire::text(condition.kind) + " " + wire::text(condition.subject));
      }
    }
  }

  AlarmEvents events;
  MonitoringPipeline pipeline{MonitoringParameters{}, events};
  std::unique_ptr<LoadedCase> loaded;
  TrackingView tracking{};
  inputs::StreamHealth trackers{};
  inputs::StreamHealth sensors{};
  wire::RegistrationState registration{};
  recording::RecorderStatus recorder{};
  std::int64_t now_ns = 0;
  std::set<std::string> raised;
  std::set<std::string> cleared;
};

TEST_F(MonitoringTest, EveryAlarmIsStillRaisedInTheTwoHundredthCaseOfADaemonsLife) {
  for (int number = 0; number < kCases; ++number) {
    const auto previous = std::move(loaded); // until the pipeline has taken the next
    raised.clear();
    cleared.clear();
    load(number);
    const std::string suffix = std::to_string(number);
    tracking = {};
    tracking.tool_count = 1;
    ASSERT_TRUE(wire::set_name(tracking.tools[0].tool, "Probe" + suffix));
    tracking.tools[0].status = bregma_wire_POSE_TOOL_HIDDEN;
    tracking.tools[0].planned = true;
    touch(0.1);
    touch(8.0); // the reference was bumped
    recorder.dropped += 1;
    run(1'000.0);
    EXPECT_TRUE(raised.contains("drift Reference" + suffix)) << number;
    EXPECT_TRUE(raised.contains("tool_hidden Probe" + suffix)) << number;
    EXPECT_TRUE(raised.contains("reference_hidden Reference" + suffix)) << number;
    EXPECT_TRUE(raised.contains("record_loss ")) << number;
    run(2'000.0);
    EXPECT_TRUE(cleared.contains("record_loss ")) << number;
    pipeline.handle(CaseChanged{static_cast<std::uint64_t>(number) + 1, nullptr});
    run(100.0);
    for (const char *kind : {"drift Reference", "tool_hidden Probe", "reference_hidden Reference"}) {
      EXPECT_TRUE(cleared.contains(kind + suffix)) << number;
    }
    if (HasFailure()) {
      break;
    }
  }
}

// A scan after the acceptance by a sensor that reads too far on tilted skin: from above, over a sphere of 90 mm.
TEST_F(MonitoringTest, AScanIsNoDriftByWhatItsSensorReadsTooFarOnTiltedSkin) {
  constexpr double kExcess_mm = 6.0;
  double statistic_if_known = 0.0;
  for (const bool known : {true, false}) {
    load(0);
    RegistrationAccepted accepted{};
    accepted.T_image_reference = {{1.0, 0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
    for (std::size_t i = 0; i < 6; ++i) {
      accepted.covariance[7 * i] = i < 3 ? 1e-6 : 0.04;
    }
    accepted.excess_mm = {known ? kExcess_mm : 0.0, 0.0, 0.0};
    pipeline.handle(MonitoringMessage(accepted));
    for (double x = -65.0; x <= 65.0; x += 13.0) {
      for (double y = -65.0; y <= 65.0; y += 13.0) {
        const double z = std::sqrt(std::max(0.0, 90.0 * 90.0 - x * x - y * y));
        if (z < 45.0) {
          continue; // steeper than 60 degrees
        }
        const surface::SurfacePoint skin = loaded->scalp.closest({x, y, z});
        SurfaceSample sample{};
        sample.position_mm = {skin.point_mm.x(), skin.point_mm.y(),
                              skin.point_mm.z() - kExcess_mm * (1.0 - skin.normal.z())};
        sample.covariance_mm2 = {0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.01};
        sample.towards_sensor = {0.0, 0.0, 1.0};
        sample.across = {1.0, 0.0, 0.0};
        pipeline.handle(MonitoringMessage(sample));
      }
    }
    run(200.0);
    const double statistic = pipeline.accuracy().drift_statistic;
    if (known) {
      EXPECT_FALSE(pipeline.accuracy().drift_detected);
      statistic_if_known = statistic;
    } else {
      EXPECT_GT(statistic, 3.0 * statistic_if_known) << "not small by itself";
    }
  }
}

// A target planned on a second image errs by two registrations. Both are drawn from the covariances that are stated.
TEST_F(MonitoringTest, ATargetOfASecondImageHasTheErrorsOfBothRegistrations) {
  casefile::Case a_case = tests::sample_case("/cases/sample");
  casefile::RegisteredImage image;
  image.name = "T2";
  image.verdict = "found";
  image.T_image_source.pose = {Eigen::Quaterniond(Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitX())), {3.0, -7.0, 11.0}};
  image.T_image_source.covariance.diagonal() << 9e-6, 4e-6, 16e-6, 0.03, 0.05, 0.02;
  image.T_image_source.covariance(1, 3) = image.T_image_source.covariance(3, 1) = 1e-4;
  put_image(a_case, image);
  const Eigen::Vector3d in_image(20.0, -15.0, 30.0);
  a_case.targets.push_back({"Cyst", in_image, "T2"});
  map_to_image(a_case, a_case.targets.back());
  const Eigen::Vector3d target = a_case.targets.back().position_mm;
  load(0, a_case);
  run(100.0);

  const wire::AccuracyState &state = pipeline.accuracy();
  ASSERT_EQ(state.target_count, 2U);
  const wire::TargetAccuracy &cyst = state.targets[1];
  geometry::Matrix6d of_patient = geometry::Matrix6d::Zero();
  of_patient.diagonal() << 1e-6, 1e-6, 1e-6, 0.04, 0.04, 0.04;
  const geometry::Matrix36d J = geometry::point_jacobian(target);
  const double of_image = (J * image.T_image_source.covariance * J.transpose()).trace();
  EXPECT_NEAR(cyst.tre_rms_mm, std::sqrt(of_image + (J * of_patient * J.transpose()).trace()), 1e-9)
      << "the part of the image is added to that of the patient's registration";
  EXPECT_NEAR(cyst.image_rms_mm, std::sqrt(of_image), 1e-9) << "and is stated apart";
  EXPECT_EQ(state.targets[0].image_rms_mm, 0.0) << "of the planning image";

  const Eigen::LLT<Eigen::Matrix3d> region(
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(cyst.covariance_mm2));
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  const auto drawn = [&](const geometry::Matrix6d &covariance, const Eigen::Vector3d &point) {
    geometry::Vector6d twist;
    for (double &value : twist) {
      value = normal(random);
    }
    twist = geometry::Matrix6d(covariance.llt().matrixL()) * twist;
    const double angle = twist.head<3>().norm();
    return Eigen::Vector3d(Eigen::AngleAxisd(angle, twist.head<3>() / angle) * point + twist.tail<3>());
  };
  int inside = 0;
  for (int draw = 0; draw < 1000; ++draw) { // the true place of the target in the image, then of that in the room
    const Eigen::Vector3d error = drawn(of_patient, drawn(image.T_image_source.covariance, target)) - target;
    inside += error.dot(region.solve(error)) <= 7.815 ? 1 : 0; // chi-square, 3 degrees of freedom, 95 %
  }
  RecordProperty("inside_95", inside);
  EXPECT_GE(inside, 930) << "seed 3";
  EXPECT_LE(inside, 970) << "seed 3";
}

TEST_F(MonitoringTest, LessThanAnHourOfRecordingIsAnAlarm) {
  run(500.0);
  EXPECT_TRUE(raised.empty()) << "nothing is recorded";
  recorder.space = {.free_bytes = 3'700'000'000, .bytes_per_s = 1e6};
  run(500.0);
  EXPECT_TRUE(raised.empty()) << "62 minutes";
  recorder.space.bytes_per_s = 2e6;
  run(500.0);
  EXPECT_TRUE(raised.contains("recording_space "));
  recorder.space.free_bytes *= 10;
  run(2'000.0);
  EXPECT_TRUE(cleared.contains("recording_space "));
}

TEST_F(MonitoringTest, TwoWritersOfOneDeviceAreACriticalAlarmThatStatesWhichIsUsed) {
  trackers.device_count = 1;
  wire::DeviceHealth &tracker = trackers.devices[0];
  ASSERT_TRUE(wire::set_name(tracker.device, "Tracker"));
  tracker.kind = bregma_wire_DEVICE_TRACKER;
  tracker.status = bregma_wire_DEVICE_LIVE;
  run(1'000.0);
  EXPECT_TRUE(raised.empty());
  tracker.other_writer = 12;
  run(100.0);
  EXPECT_TRUE(raised.contains("other_writer Tracker"));
  run(2'000.0);
  EXPECT_TRUE(cleared.contains("other_writer Tracker"));
  raised.clear();
  tracker.takeovers = 1;
  run(100.0);
  EXPECT_TRUE(raised.contains("other_writer Tracker"));
}

} // namespace
} // namespace bregma::server
