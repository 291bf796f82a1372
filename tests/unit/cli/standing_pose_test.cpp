#include "clients/cli/standing_pose.hpp"

#include <gtest/gtest.h>

#include <random>

namespace bregma::cli {
namespace {

using geometry::Vector3d;

template <class Pose> std::vector<Pose> scattered(const Pose &about, double sigma_mm, double sigma_rad, int count) {
  std::mt19937 rng(3);
  std::normal_distribution<double> normal;
  const auto vector = [&](double sigma) {
    return Vector3d(sigma * normal(rng), sigma * normal(rng), sigma * normal(rng));
  };
  std::vector<Pose> out;
  for (int i = 0; i < count; ++i) {
    const Eigen::Quaterniond turned = about.rotation() * geometry::rotation_exp(vector(sigma_rad));
    out.push_back({turned, Vector3d(about.translation() + vector(sigma_mm))});
  }
  return out;
}

TEST(StandingPose, IsTheMeanOfWhatArmAndTrackerState) {
  const StandingFlange flange(geometry::rotation_exp(Vector3d(2.0, 0.3, -1.0)), Vector3d(400.0, 10.0, 300.0));
  const StandingBody body(geometry::rotation_exp(Vector3d(0.1, 3.0, 0.4)), Vector3d(-20.0, 30.0, 1500.0));
  const auto pair = standing_pair(scattered(flange, 0.01, 1e-5, 60), scattered(body, 0.2, 2e-3, 400));
  ASSERT_TRUE(pair) << pair.error().message;
  EXPECT_LT((pair->T_base_flange.translation() - flange.translation()).norm(), 0.01);
  EXPECT_LT((pair->T_tracker_body.translation() - body.translation()).norm(), 0.05);
  EXPECT_LT(geometry::angle_between(pair->T_tracker_body.rotation(), body.rotation()), 5e-4);
}

TEST(StandingPose, AnArmThatMovesAndABodyThatIsHiddenAreRefused) {
  const auto flanges = scattered(StandingFlange(), 0.01, 1e-5, 60);
  const auto bodies = scattered(StandingBody(), 0.2, 1e-3, 30);
  EXPECT_NE(standing_pair({}, bodies).error().message.find("the arm states no pose"), std::string::npos);
  EXPECT_NE(standing_pair(flanges, scattered(StandingBody(), 0.2, 1e-3, 9)).error().message.find("seen in 9 frames"),
            std::string::npos);
  for (const StandingFlange &moved :
       {StandingFlange(Eigen::Quaterniond::Identity(), Vector3d(0.0, 0.3, 0.0)),
        StandingFlange(geometry::rotation_exp(Vector3d(0.0, 0.0, 3e-3)), Vector3d::Zero())}) {
    auto moving = flanges;
    moving.back() = moved;
    EXPECT_EQ(standing_pair(moving, bodies).error().message, "the arm moves: the pose must be one at which it stands");
  }
}

} // namespace
} // namespace bregma::cli
