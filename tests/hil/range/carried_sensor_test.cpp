// The range sensor on the simulated arm's flange, before a head, and the person who leads the arm there.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <sstream>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include "algorithms/geometry/angles.hpp"
#include "drivers/sim/arm/carried_sensor.hpp"
#include "drivers/sim/arm/leading_hand.hpp"
#include "drivers/sim/arm/simulated_arm.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/robot/arms.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::sim {
namespace {

const Vector3d kNose_mm(450.0, -20.0, 120.0);
constexpr double kYaw_rad = 0.4;

// The flange above a place of the base, its z downwards.
robot::FlangePose above(const Vector3d &place_mm) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX())), place_mm};
}

TEST(CarriedSensor, TheHeadLiesOnItsBack) {
  const Head head(bregma::test::make_head(3), 0.0, 15.0, 1);
  const BaseImage T = lying_head(head, kNose_mm, kYaw_rad);
  EXPECT_LT((T * head.nose_mm() - kNose_mm).norm(), 1e-9);
  EXPECT_LT((T.rotation() * Vector3d::UnitY() - Vector3d::UnitZ()).norm(), 1e-9);
  EXPECT_LT((T.rotation() * Vector3d::UnitZ() - Vector3d(std::cos(kYaw_rad), std::sin(kYaw_rad), 0.0)).norm(), 1e-9);
  EXPECT_NEAR(T.rotation_matrix().determinant(), 1.0, 1e-12);
}

TEST(CarriedSensor, TheBeamMeetsTheTrueSkin) {
  const Head head(bregma::test::make_head(3), 0.5, 15.0, 1);
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
  Head head(bregma::test::make_head(3), 0.0, 15.0, 1);
  const BaseImage T = lying_head(head, kNose_mm, 0.0);
  auto sensor = CarriedSensor::open(std::move(head), {{0.0, 0.0, 60.0}, Vector3d::UnitZ()}, {"GP2Y0A21", "A4"}, "", 1);
  ASSERT_TRUE(sensor) << sensor.error().message;
  EXPECT_TRUE(sensor->address().starts_with("serial:///dev/pts/"));
  const std::string path = sensor->address().substr(std::string("serial://").size());
  const int line = ::open(path.c_str(), O_RDONLY | O_NOCTTY | O_NONBLOCK);
  ASSERT_GE(line, 0) << path;
  CarriedSensor moved = std::move(*sensor); // its sensor still knows where it is
  std::string received;
  std::uint64_t now_us = 1'000'000;
  for (int i = 0; i < 400; ++i, now_us += 1'000) {
    moved.serve(above(kNose_mm + Vector3d(0.0, 0.0, 260.0)), T, false, now_us);
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

TEST(LedArm, GoesWhereAPersonLeadsItAndNowhereAfterAStop) {
  ArmSettings settings;
  settings.start << 0.0, 1.4, 0.0, 0.1, -1.1, 0.0;
  SimulatedArm arm(bregma::test::mz07f(), bregma::test::mz07f(), settings);
  std::int64_t now_ns = 1'000'000'000;
  const auto pass = [&](double seconds) {
    for (const std::int64_t end = now_ns + static_cast<std::int64_t>(1e9 * seconds); now_ns < end;) {
      (void)arm.advance(now_ns += SimulatedArm::kTick_ns);
    }
  };
  pass(0.1);
  const robot::FlangePose start = arm.true_flange();
  const auto beside = [&](double mm) {
    return robot::FlangePose(start.rotation(), Vector3d(start.translation() + mm * Vector3d::UnitY()));
  };
  ASSERT_EQ(arm.lead({beside(30.0)}, 60.0), "");
  pass(0.25);
  EXPECT_TRUE(arm.led());
  EXPECT_NEAR(arm.true_flange().translation().y() - start.translation().y(), 15.0, 1.0);
  pass(0.4);
  EXPECT_FALSE(arm.led());
  EXPECT_LT((arm.true_flange().translation() - beside(30.0).translation()).norm(), 0.01);
  EXPECT_NE(arm.lead({beside(3000.0)}, 60.0).find("out of reach"), std::string::npos);
  ASSERT_EQ(arm.lead({beside(0.0)}, 60.0), "");
  pass(0.1);
  arm.press_emergency();
  pass(1.0);
  EXPECT_FALSE(arm.led());
  EXPECT_GT(arm.true_flange().translation().y() - start.translation().y(), 20.0);
  EXPECT_EQ(arm.lead({beside(0.0)}, 60.0), "a stop is latched");
}

TEST(LedArm, APersonTouchesALandmarkByItsName) {
  const bregma::test::TemporaryFolder folder;
  const std::string fifo = (folder.path() / "hand").string();
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  FaceBeforeArm face{sim::test::make_case(), Head(bregma::test::make_head(3), 0.3, 15.0, 1), {}, {}};
  ArmSettings settings; // the flange looks down
  settings.start << 0.0, 1.019, -0.431, 0.0, -0.588, 0.0;
  SimulatedArm arm(bregma::test::mz07f(), bregma::test::mz07f(), settings);
  const Vector3d tip_mm(0.0, 0.0, 150.0);
  face.T_base_image = lying_head(face.head, arm.true_flange() * Vector3d(0.0, 0.0, 200.0), 0.0);
  face.place = MovingHead(face.T_base_image, face.head.centre_mm());
  auto hand = LeadingHand::open(fifo, face, tip_mm, arm.true_flange());
  ASSERT_TRUE(hand) << hand.error().message;
  const casefile::NamedPoint &landmark = face.a_case.landmarks.front();
  const int end = ::open(fifo.c_str(), O_WRONLY | O_NONBLOCK);
  ASSERT_GE(end, 0);
  const std::string lines =
      landmark.name + "\nNobody\nwhere\npatient 3 0 -4 0.5\npatient 3\nflange 10 0 0 0 5 0\nflange 1\n";
  ASSERT_EQ(::write(end, lines.data(), lines.size()), static_cast<ssize_t>(lines.size()));
  const robot::FlangePose first = arm.true_flange();
  const BaseImage resting = face.T_base_image;
  std::vector<std::string> news;
  double touch_mm = 1e9;
  for (std::int64_t now_ns = 1'000'000'000; now_ns < 41'000'000'000 && news.size() < 7; now_ns += 4'000'000) {
    (void)arm.advance(now_ns);
    face.advance(now_ns);
    if (std::string said = hand->serve(arm, now_ns); !said.empty()) {
      news.push_back(std::move(said));
      if (news.size() == 1) {
        touch_mm =
            (face.T_base_image.inverse() * (arm.true_flange() * tip_mm) - face.head.skin(landmark.position_mm).point_mm)
                .norm();
      }
    }
  }
  ::close(end);
  ASSERT_EQ(news.size(), 7U);
  EXPECT_EQ(news[0], "at " + landmark.name);
  EXPECT_EQ(news[1], "Nobody: is no fiducial or landmark of the case");
  const Vector3d skin_mm = face.head.skin(landmark.position_mm).point_mm;
  Vector3d told_mm;
  ASSERT_EQ(std::sscanf(news[2].c_str(), "tip %lf %lf %lf", &told_mm.x(), &told_mm.y(), &told_mm.z()), 3) << news[2];
  EXPECT_LT((told_mm - skin_mm).norm(), 0.05);
  EXPECT_LT(touch_mm, 0.05);

  // He moves the patient, and leads the flange to a place of its own.
  EXPECT_EQ(news[3], "at patient 3 0 -4 0.5");
  EXPECT_EQ(news[4], "patient 3: needs three distances and up to 60 seconds");
  EXPECT_LT(
      (face.T_base_image * landmark.position_mm - resting * landmark.position_mm - Vector3d(3.0, 0.0, -4.0)).norm(),
      1e-9);
  EXPECT_EQ(news[5], "at flange 10 0 0 0 5 0");
  EXPECT_EQ(news[6], "flange 1: needs six numbers");
  EXPECT_LT((arm.true_flange().translation() - first * Vector3d(10.0, 0.0, 0.0)).norm(), 0.05);
  EXPECT_NEAR(geometry::angle_between(arm.true_flange().rotation(), first.rotation()),
              5.0 * geometry::kRadiansPerDegree, 1e-4);
  EXPECT_FALSE(LeadingHand::open(folder.path() / "none", face, tip_mm, arm.true_flange()));
}

} // namespace
} // namespace bregma::sim
