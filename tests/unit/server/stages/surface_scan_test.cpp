// Points of a scan from what an arm and a range sensor measure.
#include "server/stages/surface_scan/surface_scan.hpp"

#include <cmath>
#include <optional>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "idl/names.hpp"

namespace bregma::server {
namespace {

using geometry::Vector3d;

constexpr std::int64_t kPeriod_ns = 8'000'000;
constexpr std::int64_t kBegin_ns = 1'000'000'000;

class SurfaceScanTest : public ::testing::Test {
protected:
  SurfaceScanTest() {
    EXPECT_TRUE(wire::set_name(request.arm, "Robot") && wire::set_name(request.sensor, "Range"));
    request.on = true;
    request.origin_mm = {0.0, 0.0, 50.0};
    request.direction = {0.0, 0.6, 0.8};
    request.window = 1;
    request.near_mm = 50.0;
    request.far_mm = 300.0;
  }
  // The first point of a flange that stands here, for this reading.
  std::optional<SurfaceScan::Point> point_for(const Eigen::Quaterniond &rotation, double reading_mm) {
    SurfaceScan scan{ToolPoseOptions{}};
    scan.request(request);
    for (int i = 0; i < 4; ++i) {
      FlangeSample flange{};
      EXPECT_TRUE(wire::set_name(flange.device, "Robot"));
      flange.acquired_ns = kBegin_ns + i * kPeriod_ns;
      flange.period_ns = kPeriod_ns;
      flange.measured_anew = true;
      flange.T_base_flange = {{rotation.w(), rotation.x(), rotation.y(), rotation.z()}, {400.0, 0.0, 300.0}};
      scan.add(flange);
    }
    RangeReading reading{};
    EXPECT_TRUE(wire::set_name(reading.device, "Range"));
    reading.acquired_ns = kBegin_ns + kPeriod_ns;
    reading.period_ns = 1'000'000;
    reading.range_mm = reading_mm;
    reading.sigma_mm = 0.5;
    scan.add(reading, kBegin_ns + 3 * kPeriod_ns);
    return scan.next(kBegin_ns + 3 * kPeriod_ns);
  }

  ScanRequest request{};
};

TEST_F(SurfaceScanTest, APointHasTheDirectionOfItsBeamAndOneAcrossThatTurnsWithTheFlange) {
  const Vector3d beam(0.0, 0.6, 0.8);
  std::vector<Vector3d> across;
  for (const double turn : {0.0, 0.7}) {
    const Eigen::Quaterniond R(Eigen::AngleAxisd(turn, Vector3d(1.0, 2.0, -1.0).normalized()));
    const auto point = point_for(R, 200.0);
    ASSERT_TRUE(point);
    EXPECT_LT((point->towards_sensor + R * beam).norm(), 1e-12);
    EXPECT_NEAR(point->across.norm(), 1.0, 1e-12);
    EXPECT_NEAR(point->across.dot(point->towards_sensor), 0.0, 1e-12);
    EXPECT_LT(
        (point->position_mm - (R * (Vector3d(0.0, 0.0, 50.0) + 200.0 * beam) + Vector3d(400.0, 0.0, 300.0))).norm(),
        1e-9);
    across.push_back(R.inverse() * point->across);
  }
  EXPECT_LT((across[0] - across[1]).norm(), 1e-12) << "fixed in the flange";
}

TEST_F(SurfaceScanTest, TheCurvesCorrectionsAreAddedAndWhatTheyLeaveIsCommonToAllPoints) {
  request.curved = true;
  request.curve_scale_mm = 1.02;
  request.curve_exponent = 1.0;
  request.curve_rms_mm = 0.3;
  request.curve_points = 2;
  request.curve_corrections[0] = {180.0, 1.0};
  request.curve_corrections[1] = {220.0, -0.5};
  const auto point = point_for(Eigen::Quaterniond::Identity(), 200.0);
  ASSERT_TRUE(point);
  const Vector3d beam(0.0, 0.6, 0.8);
  const double range_mm = (point->position_mm - Vector3d(400.0, 0.0, 350.0)).dot(beam);
  EXPECT_NEAR(range_mm, 1.02 * 200.0 + 0.25, 1e-9);
  EXPECT_NEAR(beam.dot(point->common_mm2 * beam), 0.3 * 0.3, 1e-9);
}

} // namespace
} // namespace bregma::server
