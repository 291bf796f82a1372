// What a motion of the guide beside a tracker rests on, and where the tracked patient is.
#include "server/stages/robot_motion/guide_watch.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "idl/names.hpp"

namespace bregma::server {
namespace {

using geometry::Vector3d;

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kNow_ns = 50 * kSecond_ns;

PatientPlace::Pose at(const Vector3d &position_mm, const Vector3d &turn_rad = Vector3d::Zero()) {
  return {geometry::rotation_exp(turn_rad), position_mm};
}

ReferenceView good_reference() {
  ReferenceView out;
  out.visible = out.trusted = true;
  out.acquired_ns = kNow_ns - 10'000'000;
  out.limit_ns = 100'000'000;
  out.hand_eye.checked_ns = out.acquired_ns;
  return out;
}

TrackingView live_guide(const PatientPlace::Pose &T_image_tip) {
  TrackingView out;
  out.tool_count = 1;
  (void)wire::set_name(out.tools[0].tool, "Guide");
  out.tools[0].status = bregma_wire_POSE_LIVE;
  out.tools[0].T_image_tip = wire::to_wire(T_image_tip);
  out.tools[0].tre_95_mm = 1.5;
  return out;
}

WatchedGuide guide() {
  WatchedGuide out;
  out.tool = "Guide";
  out.trajectory = "Plan";
  out.T_base_reference = at(Vector3d::Zero());
  for (std::size_t i = 0; i < out.head.size(); ++i) {
    out.head[i] = {(i & 1U) != 0 ? 100.0 : -100.0, (i & 2U) != 0 ? 100.0 : -100.0, (i & 4U) != 0 ? 100.0 : -100.0};
  }
  out.flange_body = "Marker";
  out.max_patient_mm = 2.0;
  return out;
}

TEST(PatientPlace, AveragesNoiseAndBeginsAnewAfterAJump) {
  std::mt19937 rng(3);
  std::normal_distribution<double> noise(0.0, 0.3);
  PatientPlace place;
  double squares = 0.0;
  for (int i = 0; i < 1'000; ++i) {
    place.add(at({noise(rng), noise(rng), noise(rng)}, Vector3d(noise(rng), noise(rng), noise(rng)) * 0.01));
    EXPECT_EQ(place.settled(), i + 1 >= PatientPlace::kSettled);
    squares += i >= 100 ? place.mean().translation().squaredNorm() / 2'700.0 : 0.0;
  }
  EXPECT_NEAR(std::sqrt(squares), 0.3 * std::sqrt(PatientPlace::kGain / (2.0 - PatientPlace::kGain)), 0.01);
  place.add(at({20.0, 0.0, 0.0}));
  EXPECT_FALSE(place.settled());
  EXPECT_EQ(place.mean().translation().x(), 20.0);
  place.add(at({20.0, 0.0, 0.0}, {0.0, 0.0, 0.1}));
  EXPECT_NEAR(geometry::rotation_log(place.mean().rotation()).z(), 0.1, 1e-12);
  place.add(at(Vector3d::Constant(std::nan(""))));
  EXPECT_FALSE(place.settled());
}

TEST(GuideWatch, NamesTheFirstThingThatDoesNotHold) {
  const auto problem = [](const ReferenceView &reference, const char *body = "Marker") {
    std::string following = following_problem(reference, body, kNow_ns);
    EXPECT_EQ(following, planning_problem(reference, body, kNow_ns));
    return following;
  };
  EXPECT_EQ(problem(good_reference()), "");
  EXPECT_NE(problem({}).find("not seen"), std::string::npos) << "nothing was seen yet";
  ReferenceView view = good_reference();
  view.hand_eye.disagrees = true;
  EXPECT_NE(problem(view).find("is not where hand-eye was calibrated"), std::string::npos);
  view = good_reference();
  view.acquired_ns = kNow_ns - view.limit_ns - 1;
  EXPECT_NE(problem(view).find("too old"), std::string::npos);
  view.visible = false;
  EXPECT_NE(problem(view).find("not seen"), std::string::npos);
  view = good_reference();
  view.trusted = false;
  EXPECT_NE(problem(view).find("not plausible"), std::string::npos);
  view = good_reference();
  EXPECT_NE(problem(view, "").find("flange_body"), std::string::npos);
  view.hand_eye.checked_ns = view.acquired_ns - kUncheckedMotion_ns - 1;
  EXPECT_NE(problem(view).find("Marker on the flange is not seen"), std::string::npos);
}

TEST(GuideWatch, AHiddenReferenceEndsAMotionWhenItsPoseIsAsOldAsThatOfASilentTracker) {
  ReferenceView view = good_reference();
  view.visible = false;
  TrackingView hidden = live_guide(at(Vector3d::Zero()));
  hidden.tools[0].status = bregma_wire_POSE_REFERENCE_HIDDEN;
  PatientPlace place;
  place.add(at(Vector3d::Zero()));
  const auto problem = [&](std::int64_t age_ns) {
    view.acquired_ns = view.hand_eye.checked_ns = kNow_ns - age_ns;
    return guide_problem(guide(), place, view, hidden, kNow_ns);
  };
  EXPECT_EQ(problem(20'000'000), "");
  EXPECT_EQ(problem(view.limit_ns), "");
  EXPECT_EQ(problem(view.limit_ns + 1), "the patient's reference is not seen by the tracker");
  // But no motion begins.
  (void)problem(20'000'000);
  EXPECT_EQ(planning_problem(view, "Marker", kNow_ns), "the patient's reference is not seen by the tracker");
  view.trusted = false;
  EXPECT_NE(problem(20'000'000).find("not plausible"), std::string::npos);
  view.trusted = true;
  hidden.tools[0].status = bregma_wire_POSE_IMPLAUSIBLE;
  EXPECT_EQ(problem(20'000'000), "Guide is not live");
}

TEST(PatientPlace, AfterHiddenFramesItIsWhereItWouldBeWithoutThem) {
  PatientPlace seen, hidden;
  for (int i = 0; i < 40; ++i) {
    seen.add(at(Vector3d::Zero()));
    hidden.add(at(Vector3d::Zero()));
  }
  for (int i = 0; i < 4; ++i) {
    seen.add(at({3.0, 0.0, 0.0}));
  }
  hidden.add(at({3.0, 0.0, 0.0}), 4);
  EXPECT_NEAR(hidden.mean().translation().x(), seen.mean().translation().x(), 1e-9);
  EXPECT_GT(hidden.mean().translation().x(), 1.4);
}

TEST(GuideWatch, APatientMayMoveByTheLimitAtTheFarSideOfTheHead) {
  const TrackingView tracking = live_guide(at(Vector3d::Zero()));
  const auto problem = [&](const PatientPlace::Pose &there, const TrackingView &shown) {
    PatientPlace place;
    place.add(there);
    return guide_problem(guide(), place, good_reference(), shown, kNow_ns);
  };
  EXPECT_EQ(problem(at({1.9, 0.0, 0.0}), tracking), "");
  EXPECT_EQ(problem(at({2.1, 0.0, 0.0}), tracking),
            "the patient has moved by 2.1 mm since the path was planned (limit 2.0 mm)");
  const double lever_mm = 100.0 * std::sqrt(2.0);
  EXPECT_EQ(problem(at(Vector3d::Zero(), {0.0, 0.0, 1.9 / lever_mm}), tracking), "");
  EXPECT_NE(problem(at(Vector3d::Zero(), {0.0, 0.0, 2.1 / lever_mm}), tracking), "");
  EXPECT_NE(problem(at(Vector3d::Constant(std::nan(""))), tracking), "") << "what is not finite has moved";
  TrackingView hidden = tracking;
  hidden.tools[0].status = bregma_wire_POSE_TOOL_HIDDEN;
  EXPECT_EQ(problem(at(Vector3d::Zero()), hidden), "Guide is not live");
  EXPECT_EQ(problem(at(Vector3d::Zero()), {}), "Guide is not live");
}

TEST(GuideWatch, TheShownGuideIsComparedWithItsPlace) {
  WatchedGuide plan = guide();
  plan.tip_mm = {10.0, 20.0, 30.0};
  const GuideEnd end = guide_end(plan, live_guide(at({10.0, 23.0, 34.0}, {0.02, 0.0, 0.0})));
  EXPECT_TRUE(end.live);
  EXPECT_NEAR(end.off_mm, 5.0, 1e-9);
  EXPECT_NEAR(end.angle_rad, 0.02, 1e-9);
  EXPECT_EQ(end.tre_95_mm, 1.5);
  EXPECT_FALSE(guide_end(plan, {}).live);
}

} // namespace
} // namespace bregma::server
