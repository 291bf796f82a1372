// The range sensor on the simulated arm's flange, before a head.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "drivers/sim/arm/carried_sensor.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::sim {
namespace {

const Vector3d kNose_mm(450.0, -20.0, 120.0);
constexpr double kYaw_rad = 0.4;

// The flange above a place of the base, its z downwards.
robot::FlangePose above(const Vector3d &place_mm) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX())), place_mm};
}

TEST(CarriedSensor, TheHeadLiesOnItsBack) {
  const Head head(test::make_head(3), 0.0, 15.0, 1);
  const BaseImage T = lying_head(head, kNose_mm, kYaw_rad);
  EXPECT_LT((T * head.nose_mm() - kNose_mm).norm(), 1e-9);
  EXPECT_LT((T.rotation() * Vector3d::UnitY() - Vector3d::UnitZ()).norm(), 1e-9);
  EXPECT_LT((T.rotation() * Vector3d::UnitZ() - Vector3d(std::cos(kYaw_rad), std::sin(kYaw_rad), 0.0)).norm(), 1e-9);
  EXPECT_NEAR(T.rotation_matrix().determinant(), 1.0, 1e-12);
}

TEST(CarriedSensor, TheBeamMeetsTheTrueSkin) {
  const Head head(test::make_head(3), 0.5, 15.0, 1);
  const BaseImage T = lying_head(head, kNose_mm, kYaw_rad);
  const FlangeBeam beam{{0.0, 0.0, 60.0}, Vector3d::UnitZ()};
  const BeamTarget nose = beam_on_head(head, T, above(kNose_mm + Vector3d(0.0, 0.0, 260.0)), beam);
  EXPECT_NEAR(nose.distance_mm, 200.0 - head.skin_error_mm(head.nose_mm()), 0.2);
  EXPECT_TRUE(std::isnan(nose.other_mm));
  // Towards the top of the head the skin falls away, and its normal points there.
  const Vector3d there = 55.0 * Vector3d(std::cos(kYaw_rad), std::sin(kYaw_rad), 0.0);
  const BeamTarget brow = beam_on_head(head, T, above(kNose_mm + there + Vector3d(0.0, 0.0, 260.0)), beam);
  EXPECT_GT(brow.distance_mm, nose.distance_mm);
  EXPECT_GT(brow.tilt_rad, 0.1);
  // The flange's y is the base's -y.
  EXPECT_NEAR(brow.azimuth_rad, -kYaw_rad, 0.3);
  EXPECT_GT(beam_on_head(head, T, above(Vector3d(900.0, 0.0, 300.0)), beam).distance_mm, 1000.0);
}

TEST(CarriedSensor, ItsLineGivesTheReadingsOfTheFlangeThatIsHere) {
  Head head(test::make_head(3), 0.0, 15.0, 1);
  const BaseImage T = lying_head(head, kNose_mm, 0.0);
  auto sensor =
      CarriedSensor::open(std::move(head), T, {{0.0, 0.0, 60.0}, Vector3d::UnitZ()}, {"GP2Y0A21", "A4"}, "", 1);
  ASSERT_TRUE(sensor) << sensor.error().message;
  EXPECT_TRUE(sensor->address().starts_with("serial:///dev/pts/"));
  const std::string path = sensor->address().substr(std::string("serial://").size());
  const int line = ::open(path.c_str(), O_RDONLY | O_NOCTTY | O_NONBLOCK);
  ASSERT_GE(line, 0) << path;
  CarriedSensor moved = std::move(*sensor); // its sensor still knows where it is
  std::string received;
  std::uint64_t now_us = 1'000'000;
  for (int i = 0; i < 400; ++i, now_us += 1'000) {
    moved.serve(above(kNose_mm + Vector3d(0.0, 0.0, 260.0)), false, now_us);
    std::array<char, 512> bytes{};
    if (const auto size = ::read(line, bytes.data(), bytes.size()); size > 0) {
      received.append(bytes.data(), static_cast<std::size_t>(size));
    }
  }
  ::close(line);
  std::vector<double> volts;
  std::istringstream lines(received);
  for (std::string text; std::getline(lines, text);) {
    const auto message = range::parse(text.substr(0, text.find('\r')));
    if (const auto *reading = message ? std::get_if<range::Reading>(&*message) : nullptr; reading && reading->counts) {
      volts.push_back(5.0 * *reading->counts / 1023.0);
    }
  }
  ASSERT_GT(volts.size(), 300U);
  std::nth_element(volts.begin(), volts.begin() + 150, volts.end());
  EXPECT_NEAR(volts[150], sharp_volts(200.0), 0.02);
}

} // namespace
} // namespace bregma::sim
