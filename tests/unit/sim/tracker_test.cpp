// Errors of the tracker: statistics of its poses, occlusion of markers, clock, losses.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/registration/points/paired_points.hpp"
#include "drivers/sim/optical_tracker.hpp"
#include "idl/names.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::sim::test {

namespace {

constexpr std::uint64_t kTrackerSeed = 11;

struct Setting {
  explicit Setting(const TrackerParameters &parameters = {})
      : patient(make_case(), {}, kTrackerSeed), tracker(patient, parameters, kTrackerSeed) {}

  // Stylus next to the head, turned away from the camera by the angle.
  [[nodiscard]] T_TrackerTool stylus(double turned_deg, const Vector3d &at = Vector3d(300, 50, 1600)) const {
    const auto &model = patient.tool("Stylus")->model;
    const Vector3d to_camera = -at.normalized();
    const Vector3d axis = to_camera.cross(Vector3d(0.2, 1.0, 0.0)).normalized();
    const Quaterniond straight = point_tool(model, axis, to_camera);
    return {Quaterniond(Eigen::AngleAxisd(turned_deg * geometry::kRadiansPerDegree, axis)) * straight, at};
  }
  [[nodiscard]] wire::TrackedTool measure(const T_TrackerTool &T, bool covered = false) {
    return tracker.measure(*patient.tool("Stylus"), T, covered);
  }

  Patient patient;
  OpticalTracker tracker;
};

int bits(std::uint32_t mask) { return __builtin_popcount(mask); }

} // namespace

// The covariance of the fitted poses is that of least squares with unequal noise: (J'J)^-1 J'SJ (J'J)^-1.
TEST(OpticalTracker, PoseErrorsHaveTheSandwichCovariance) {
  Setting setting;
  for (const double turned_deg : {5.0, 40.0}) {
    const T_TrackerTool T = setting.stylus(turned_deg);
    const auto &markers = setting.patient.tool("Stylus")->model.markers_mm;
    const auto expected = registration::marker_fit_covariance(markers, 0xFU, T, 0.10, 0.25);
    const std::array<Vector3d, 2> points{Vector3d(0, 0, 0), Vector3d(-150, 0, -12)}; // the body and the tip
    std::array<geometry::Matrix3d, 2> found{geometry::Matrix3d::Zero(), geometry::Matrix3d::Zero()};
    std::array<Vector3d, 2> mean{Vector3d::Zero(), Vector3d::Zero()};
    const int count = 20000;
    double rms = 0.0;
    for (int i = 0; i < count; ++i) {
      const wire::TrackedTool seen = setting.measure(T);
      ASSERT_EQ(seen.status, bregma_wire_TOOL_VISIBLE);
      const auto pose = wire::from_wire<frame::Tracker, frame::Tool>(seen.T_tracker_tool);
      for (std::size_t k = 0; k < points.size(); ++k) {
        const Vector3d error = pose * points[k] - T * points[k];
        found[k] += error * error.transpose() / count;
        mean[k] += error / count;
      }
      rms += seen.marker_rms_mm * seen.marker_rms_mm / count;
    }
    for (std::size_t k = 0; k < points.size(); ++k) {
      const auto J = geometry::point_jacobian(T * points[k]);
      const geometry::Matrix3d wanted = J * expected * J.transpose();
      EXPECT_LT((found[k] - wanted).norm() / wanted.norm(), 0.04)
          << "turned " << turned_deg << " deg, at " << points[k].transpose() << "\nexpected\n"
          << wanted << "\nfound\n"
          << found[k];
      EXPECT_LT(mean[k].norm(), 0.01) << "unbiased";
    }
    // Four markers give twelve coordinates and the fit uses six degrees of freedom: half of the noise remains.
    EXPECT_NEAR(rms, 0.5 * (2 * 0.01 + 0.0625), 0.02);
  }
}

TEST(OpticalTracker, LosesMarkersByAngle) {
  Setting setting;
  EXPECT_EQ(setting.measure(setting.stylus(50.0)).status, bregma_wire_TOOL_VISIBLE);
  EXPECT_EQ(setting.measure(setting.stylus(70.0)).status, bregma_wire_TOOL_HIDDEN);
  EXPECT_EQ(setting.measure(setting.stylus(180.0)).status, bregma_wire_TOOL_HIDDEN) << "from behind";
}

TEST(OpticalTracker, LosesMarkersOutsideTheVolume) {
  Setting setting;
  EXPECT_EQ(setting.measure(setting.stylus(0.0, {0, 500, 1600})).status, bregma_wire_TOOL_VISIBLE);
  EXPECT_EQ(setting.measure(setting.stylus(0.0, {0, 0, 900})).status, bregma_wire_TOOL_OUT_OF_VOLUME) << "too near";
  EXPECT_EQ(setting.measure(setting.stylus(0.0, {0, 0, 2500})).status, bregma_wire_TOOL_OUT_OF_VOLUME) << "too far";
  EXPECT_EQ(setting.measure(setting.stylus(0.0, {1200, 0, 1600})).status, bregma_wire_TOOL_OUT_OF_VOLUME) << "beside";
  EXPECT_TRUE(setting.tracker.in_volume({0, 0, 951}));
  EXPECT_FALSE(setting.tracker.in_volume({0, 0, 949}));
}

TEST(OpticalTracker, LosesMarkersBehindTheHead) {
  Setting setting;
  const Vector3d camera = setting.patient.camera_mm();
  const Vector3d centre = setting.patient.head.centre_mm();
  const Vector3d behind = centre + 180.0 * (centre - camera).normalized();
  const auto T_tracker_image = setting.patient.T_tracker_image;
  const auto hidden = setting.stylus(0.0, T_tracker_image * behind);
  const auto sight = setting.tracker.look(*setting.patient.tool("Stylus"), hidden);
  EXPECT_EQ(bits(sight.in_volume), 4);
  EXPECT_EQ(bits(sight.seen), 0);
  EXPECT_EQ(setting.measure(hidden).status, bregma_wire_TOOL_HIDDEN);
  // At a distance of the head's width from the line of sight: all visible again.
  const auto free = setting.stylus(0.0, T_tracker_image * behind + Vector3d(220, 0, 0));
  EXPECT_EQ(bits(setting.tracker.look(*setting.patient.tool("Stylus"), free).seen), 4);
}

TEST(OpticalTracker, ReportsTheUsedMarkers) {
  Setting setting;
  const Vector3d camera = setting.patient.camera_mm();
  const Vector3d centre = setting.patient.head.centre_mm();
  const Vector3d behind = centre + 180.0 * (centre - camera).normalized();
  bool partly = false;
  for (double aside = 0.0; aside < 220.0; aside += 1.0) {
    const auto T = setting.stylus(0.0, setting.patient.T_tracker_image * behind + Vector3d(aside, 0, 0));
    const auto sight = setting.tracker.look(*setting.patient.tool("Stylus"), T);
    const auto seen = setting.measure(T);
    if (bits(sight.seen) < 3) {
      EXPECT_EQ(seen.status, bregma_wire_TOOL_HIDDEN);
      EXPECT_EQ(seen.used_markers, 0U);
      EXPECT_TRUE(std::isnan(seen.T_tracker_tool.translation_mm[0])) << "a pose that is not measured is not given";
    } else {
      EXPECT_EQ(seen.used_markers, sight.seen);
      EXPECT_EQ(seen.status, bits(sight.seen) == 4 ? bregma_wire_TOOL_VISIBLE : bregma_wire_TOOL_PARTLY_VISIBLE);
      partly = partly || bits(sight.seen) == 3;
    }
  }
  EXPECT_TRUE(partly) << "the edge of the head hides one marker after the other";
}

TEST(OpticalTracker, CoveringAToolDoesNotChangeLaterNoise) {
  Setting one;
  Setting other;
  const auto T = one.stylus(10.0);
  EXPECT_EQ(one.measure(T, true).status, bregma_wire_TOOL_HIDDEN);
  (void)other.measure(T, false);
  const auto a = one.measure(T);
  const auto b = other.measure(T);
  EXPECT_EQ(translation(a.T_tracker_tool), translation(b.T_tracker_tool));
}

TEST(DeviceClock, HasOffsetDriftAndJitter) {
  TrackerParameters parameters;
  parameters.clock_offset_ms = -250.0;
  parameters.clock_drift_ppm = 50.0;
  parameters.clock_jitter_ms = 0.05;
  DeviceClock clock(parameters, kTrackerSeed);
  const int count = 5000;
  double sum = 0.0;
  double sum_squared = 0.0;
  for (int i = 0; i < count; ++i) {
    const std::int64_t elapsed_ns = std::int64_t{i} * 20'000'000;
    const std::int64_t host = kStart_ns + elapsed_ns;
    const double off_ms = static_cast<double>(clock.stamp(host) - host) * 1e-6;
    const double expected_ms = -250.0 + 50e-6 * static_cast<double>(elapsed_ns) * 1e-6;
    sum += (off_ms - expected_ms) / count;
    sum_squared += (off_ms - expected_ms) * (off_ms - expected_ms) / count;
  }
  EXPECT_NEAR(sum, 0.0, 0.003);
  EXPECT_NEAR(std::sqrt(sum_squared), 0.05, 0.002);
}

TEST(Patient, TheTruthDiffersFromThePlanAsStated) {
  const auto a_case = make_case();
  double sum = 0.0;
  int count = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    const Patient patient(a_case, {}, seed);
    for (std::size_t i = 0; i < a_case.fiducials.size(); ++i) {
      sum += (patient.fiducials[i].position_mm - a_case.fiducials[i].position_mm).squaredNorm();
      count += 3;
    }
    for (const auto &tool : patient.tools) {
      EXPECT_NEAR((tool.tip_mm - tool.model.nominal_tip_mm).norm(), 0.7, 1e-9);
    }
    EXPECT_NEAR((patient.camera_mm() - patient.head.centre_mm()).norm(), 1600.0, 1e-6);
  }
  EXPECT_NEAR(std::sqrt(sum / count), a_case.limits.fle_image_mm, 0.03);
}

TEST(Head, SkinErrorIsSmoothAndAsLargeAsStated) {
  const auto mesh = make_case().scalp.mesh;
  double sum = 0.0;
  double product_near = 0.0;
  double product_far = 0.0;
  int count = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Head head(mesh, 0.4, 12.0, seed);
    for (std::size_t i = 0; i < mesh.vertices_mm.size(); i += 20) {
      const Vector3d p = mesh.vertices_mm[i];
      const double here = head.skin_error_mm(p);
      sum += here * here;
      product_near += here * head.skin_error_mm(p + Vector3d(12, 0, 0));
      product_far += here * head.skin_error_mm(p + Vector3d(0, 40, 0));
      ++count;
    }
  }
  EXPECT_NEAR(std::sqrt(sum / count), 0.4, 0.04);
  EXPECT_NEAR(product_near / sum, std::exp(-0.5), 0.1) << "the correlation length";
  EXPECT_NEAR(product_far / sum, 0.0, 0.1);
}

} // namespace bregma::sim::test
