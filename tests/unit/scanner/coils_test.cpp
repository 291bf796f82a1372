// Coils found in scans, named, and the robot registered by them: in the simulated scanner, and in drawn stacks.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "algorithms/mri/coils/verification.hpp"
#include "drivers/sim/random.hpp"
#include "tests/unit/scanner/drawn_stacks.hpp"
#include "tests/unit/scanner/session_fixture.hpp"

namespace bregma::mri::test {

namespace {

using sim::scanner::plan_of;
using sim::scanner::Plane;
using sim::scanner::SimulatedScanner;

RobotRegistrationOptions undistorted() {
  RobotRegistrationOptions out;
  out.uncorrected_sigma_mm = 0.1;
  return out;
}

// Top and bottom scans of the mid pillars.
struct Session {
  explicit Session(std::uint64_t seed, const sim::scanner::ScannerOptions &options = {}) : scanner(options, seed) {}
  void scan(bool opposed = false) {
    top = pair_of(scanner, frame, plan_of(Plane::kCoronal, Vector3d(0, 55, 0), 60), {"mid-top"}, "top", opposed);
    bottom =
        pair_of(scanner, frame, plan_of(Plane::kCoronal, Vector3d(0, -55, 0), 60), {"mid-bottom"}, "bottom", opposed);
  }
  [[nodiscard]] std::vector<CoilScan> scans() const { return {top->scan, bottom->scan}; }
  // Error of the mapped origin of the frame, in Base.
  [[nodiscard]] double target_error_mm(const RobotRegistration &r) const {
    return (r.T_base_device.pose * scanner.truth().T_device_base.translation()).norm();
  }

  SimulatedScanner scanner;
  CoilFrame frame = drawn_frame();
  std::unique_ptr<Pair> top, bottom;
};

bool mentions(const std::vector<std::string> &notes, const std::string &words) {
  return std::any_of(notes.begin(), notes.end(),
                     [&](const std::string &note) { return note.find(words) != std::string::npos; });
}

} // namespace

TEST(Coils, OfASimulatedSessionAreFoundNamedAndRegistered) {
  Session session(21);
  session.scan();
  RobotRegistrationOptions options;
  options.correction = true_gradients(session.scanner.field());
  const RobotRegistration r = register_robot(session.frame, session.scans(), options);
  ASSERT_EQ(r.verdict, RegistrationVerdict::kFound) << r.reason;
  EXPECT_TRUE(r.notes.empty()) << r.notes.front();
  ASSERT_EQ(r.coils.size(), 8U);
  for (const LocatedCoil &c : r.coils) {
    const Vector3d error = c.position_mm - session.scanner.truth().coils_device_mm[static_cast<std::size_t>(c.coil)];
    EXPECT_LT(error.norm(), 0.9) << session.frame.coils[static_cast<std::size_t>(c.coil)].name; // B0 is not corrected
  }
  EXPECT_LT(session.target_error_mm(r), 0.8);
  EXPECT_LT(r.opme_mm, 0.75);

  // The variants of the paper are less exact, but name the same coils.
  for (const CoilMethod method : {CoilMethod::kHoughCircles, CoilMethod::kSingleSlice}) {
    options.artefacts.method = method;
    EXPECT_EQ(register_robot(session.frame, session.scans(), options).coils.size(), 8U);
  }
}

// B0 ten times as large as that of a shimmed magnet: 80 Hz are half a millimetre.
TEST(Coils, OpposedReadOutsAreFreeOfB0AndShowIt) {
  sim::scanner::ScannerOptions scanner;
  scanner.field.kind = sim::scanner::FieldKind::kNone;
  scanner.field.b0_Hz = 80.0;
  scanner.fine_groups = {"mid-top", "mid-bottom"};
  Session session(23, scanner);
  session.scan(true);
  const RobotRegistration r = register_robot(session.frame, session.scans(), undistorted());
  ASSERT_EQ(r.verdict, RegistrationVerdict::kFound) << r.reason;
  ASSERT_EQ(r.coils.size(), 8U);
  const auto protocol = sim::scanner::coil_protocol(60);
  double largest_mm = 0.0;
  for (const LocatedCoil &c : r.coils) {
    const Vector3d real = session.scanner.truth().coils_device_mm[static_cast<std::size_t>(c.coil)];
    const double b0_mm = session.scanner.field().b0_Hz(real) * protocol.pixel_mm() / protocol.bandwidth_Hz;
    largest_mm = std::max(largest_mm, std::abs(b0_mm));
    EXPECT_LT(std::abs(c.position_mm.x() - real.x()), 0.25) << c.coil; // the read-out runs along x
    EXPECT_NEAR(c.b0_mm.x(), b0_mm, 0.25) << c.coil;
    EXPECT_LT(c.b0_mm.tail<2>().norm(), 0.15) << c.coil;
  }
  EXPECT_GT(largest_mm, 0.6);
}

TEST(Coils, ABrokenAndAMovedCoilAreReportedAndTheRestRegisters) {
  sim::scanner::ScannerOptions options;
  options.field.kind = sim::scanner::FieldKind::kNone;
  options.field.b0_Hz = 10.0;
  Session session(22, options);
  session.scanner.break_coil(static_cast<std::size_t>(session.frame.find("mid-top-2")));
  session.frame.coils[static_cast<std::size_t>(session.frame.find("mid-bottom-3"))].position_mm += Vector3d(0, 5, 0);
  session.scan();
  RobotRegistrationOptions o;
  o.uncorrected_sigma_mm = 0.2;
  const RobotRegistration r = register_robot(session.frame, session.scans(), o);
  ASSERT_EQ(r.verdict, RegistrationVerdict::kFound) << r.reason;
  EXPECT_TRUE(mentions(r.notes, "mid-top-2 is missing"));
  EXPECT_TRUE(mentions(r.notes, "mid-bottom-3 is "));
  EXPECT_LT(session.target_error_mm(r), 0.8);
}

TEST(Artefacts, AreCentredWithinATenthOfAPixel) {
  const std::vector<Vector3d> balls{{-41.3, 20.4, 10.7}, {30.2, -33.9, -8.1}};
  const auto found = find_artefacts(drawn({}, 0, 1), drawn(balls, 6.0, 2));
  ASSERT_TRUE(found.has_value()) << found.error();
  ASSERT_EQ(found->artefacts.size(), 2U);
  for (const Vector3d &ball : balls) {
    double nearest = 1e9;
    for (const CoilArtefact &a : found->artefacts) {
      nearest = std::min(nearest, (a.centre_mm - ball).norm());
    }
    EXPECT_LT(nearest, 0.15);
  }
  EXPECT_NEAR(found->noise, 30.0 * std::sqrt(2.0), 4.0);
}

TEST(Artefacts, OneAtTheBorderOfTheScanIsMarked) {
  const auto found = find_artefacts(drawn({}, 0, 1, 1.0, 40), drawn({{0, 10, 29.5}}, 7.0, 2, 1.0, 40));
  ASSERT_TRUE(found.has_value());
  ASSERT_EQ(found->artefacts.size(), 1U);
  EXPECT_TRUE(found->artefacts.front().cut_off);
}

TEST(Artefacts, PairsThatDoNotBelongTogetherAreRefused) {
  const std::vector<Vector3d> balls{{-41, 20, 10}};
  const Stack background = drawn({}, 0, 1), foreground = drawn(balls, 6.0, 2);
  Stack clipped = foreground;
  for (float &v : clipped.voxels) {
    v = std::min(v, 1000.0F);
  }
  const auto saturated = find_artefacts(background, clipped);
  ASSERT_FALSE(saturated.has_value());
  EXPECT_NE(saturated.error().find("the foreground is saturated"), std::string::npos) << saturated.error();

  const auto exchanged = find_artefacts(foreground, background);
  ASSERT_FALSE(exchanged.has_value());
  EXPECT_NE(exchanged.error().find("exchanged"), std::string::npos) << exchanged.error();

  const auto brighter = find_artefacts(background, drawn(balls, 6.0, 2, 1.6));
  ASSERT_FALSE(brighter.has_value());
  EXPECT_NE(brighter.error().find("160 % as bright"), std::string::npos) << brighter.error();

  Stack other = foreground;
  other.T_image_index(0, 3) += 4.0;
  const auto moved = find_artefacts(background, other);
  ASSERT_FALSE(moved.has_value());
  EXPECT_NE(moved.error().find("same slices"), std::string::npos) << moved.error();

  const auto scene = find_artefacts(background, drawn({{0, 0, 0}}, 75.0, 2));
  ASSERT_FALSE(scene.has_value());

  Stack dark = background;
  std::fill(dark.voxels.begin(), dark.voxels.end(), 0.0F);
  ASSERT_FALSE(find_artefacts(dark, dark).has_value());
  const auto empty = find_artefacts(background, dark);
  ASSERT_FALSE(empty.has_value());
  EXPECT_EQ(empty.error(), "the foreground shows no signal");

  // Some slices that were never filled.
  Stack holes = foreground;
  std::fill(holes.voxels.begin() + static_cast<std::ptrdiff_t>(holes.offset(0, 0, 50)),
            holes.voxels.begin() + static_cast<std::ptrdiff_t>(holes.offset(0, 0, 53)), 0.0F);
  const auto lacking = find_artefacts(background, holes);
  ASSERT_FALSE(lacking.has_value());
  EXPECT_NE(lacking.error().find("slice 51 of the foreground is 10 % as bright"), std::string::npos) << lacking.error();
}

TEST(Artefacts, SlicesMayComeOneByOneInAnyOrder) {
  const Stack background = drawn({}, 0, 1), foreground = drawn({{-41.3, 20.4, 10.7}, {30.2, -33.9, -8.1}}, 6.0, 2);
  const auto batch = find_artefacts(background, foreground);
  auto finder = ArtefactFinder::start(background);
  ASSERT_TRUE(batch && finder);
  const std::size_t pixels = std::size_t{128} * 128;
  const auto slice = [&](int k) { return std::span(foreground.voxels).subspan(foreground.offset(0, 0, k), pixels); };
  for (int k = 99; k > 0; --k) {
    ASSERT_TRUE(finder->add(k, slice(k)));
  }
  EXPECT_EQ(finder->finish().error(), "1 of 100 slices of the foreground are missing");
  EXPECT_FALSE(finder->add(100, slice(0)));
  EXPECT_FALSE(finder->add(0, slice(0).first(100)));
  ASSERT_TRUE(finder->add(0, slice(0)));
  const auto streamed = finder->finish();
  ASSERT_TRUE(streamed);
  ASSERT_EQ(streamed->artefacts.size(), batch->artefacts.size());
  for (std::size_t i = 0; i < batch->artefacts.size(); ++i) {
    EXPECT_LT((streamed->artefacts[i].centre_mm - batch->artefacts[i].centre_mm).norm(), 1e-6);
  }
}

TEST(Artefacts, WhatOneReadOutAloneShowsIsLeftOut) {
  const auto at = [](double x, bool cut_off) {
    CoilArtefact out;
    out.centre_mm = {x, 0.0, 0.0};
    out.covariance = 0.01 * Eigen::Matrix3d::Identity();
    out.cut_off = cut_off;
    return out;
  };
  // The first is not shown by the other scan, and the second is nearer to what that shows.
  const std::vector<CoilArtefact> forward{at(-8.0, false), at(1.5, false), at(40.0, false)};
  const std::vector<CoilArtefact> reversed{at(0.5, false), at(41.0, true)};
  const auto mean = mean_of_read_outs(forward, reversed, 12.0);
  ASSERT_EQ(mean.size(), 2U);
  EXPECT_EQ(mean[0].centre_mm, Vector3d(1.0, 0.0, 0.0));
  EXPECT_EQ(mean[0].b0_mm, Vector3d(0.5, 0.0, 0.0));
  EXPECT_LT(mean[0].covariance(0, 0), 0.01);
  EXPECT_FALSE(mean[0].cut_off);
  EXPECT_TRUE(mean[1].cut_off) << "in the second";
  // A coil that the second polarity of the current does not show stays.
  const auto polarities = mean_of_polarities(forward, reversed, 12.0);
  ASSERT_EQ(polarities.size(), 3U);
  EXPECT_EQ(polarities[0].centre_mm, forward[0].centre_mm);
  EXPECT_FALSE(polarities[0].b0_mm.allFinite());
}

TEST(Artefacts, NothingIsFoundInTwoBackgrounds) {
  const auto found = find_artefacts(drawn({}, 0, 1), drawn({}, 0, 2));
  ASSERT_TRUE(found.has_value());
  EXPECT_TRUE(found->artefacts.empty());
}

TEST(Names, FollowThePatternWhateverTheOrder) {
  const CoilFrame frame = small_frame();
  const std::vector<int> all{0, 1, 2, 3, 4, 5};
  const std::vector<std::vector<int>> on{all};
  sim::Random random(5, "names");
  for (int run = 0; run < 50; ++run) {
    const Rigid3<frame::Device, frame::Base> T(geometry::rotation_exp(3.0 * random.direction()), random.normal3(30.0));
    std::vector<int> order = all;
    std::rotate(order.begin(), order.begin() + run % 6, order.end());
    std::vector<Sighting> seen;
    for (const int c : order) {
      seen.push_back({T * frame.coils[static_cast<std::size_t>(c)].position_mm + random.normal3(0.8), 0});
    }
    const Naming naming = name_coils(frame, on, seen);
    ASSERT_EQ(naming.status, Naming::Status::kNamed) << run;
    EXPECT_EQ(naming.coil, order) << run;
    EXPECT_TRUE(naming.missing.empty());
  }
}

TEST(Names, ASymmetricPatternIsAmbiguous) {
  CoilFrame frame;
  frame.coils = {
      {"1", "a", {-50, -50, 0}}, {"2", "a", {50, -50, 0}}, {"3", "a", {50, 50, 0}}, {"4", "a", {-50, 50, 0}}};
  const std::vector<std::vector<int>> on{{0, 1, 2, 3}};
  std::vector<Sighting> seen;
  for (const FrameCoil &c : frame.coils) {
    seen.push_back({c.position_mm + Vector3d(0.3, 0.1, -0.2), 0});
  }
  EXPECT_EQ(name_coils(frame, on, seen).status, Naming::Status::kAmbiguous);
}

TEST(Names, FarMoreArtefactsThanCoilsEndTheSearch) {
  CoilFrame frame;
  std::vector<int> all;
  sim::Random random(5, "places");
  for (int i = 0; i < 24; ++i) {
    const Vector3d at(random.uniform(-100, 100), random.uniform(-100, 100), random.uniform(-100, 100));
    frame.coils.push_back({"c" + std::to_string(i), "c", at});
    all.push_back(i);
  }
  std::vector<Sighting> sightings;
  for (int i = 0; i < 60; ++i) {
    sightings.push_back({Vector3d(random.uniform(-90, 90), random.uniform(-90, 90), random.uniform(-90, 90)), 0});
  }
  const std::vector<std::vector<int>> on{all};
  EXPECT_EQ(name_coils(frame, on, sightings).status, Naming::Status::kTooMany);
  sightings.resize(400);
  EXPECT_EQ(name_coils(frame, on, sightings).status, Naming::Status::kTooMany);
}

TEST(Names, MissingAndForeignArtefactsAreLeftOut) {
  const CoilFrame frame = small_frame();
  const std::vector<std::vector<int>> on{{0, 1, 2, 3, 4, 5}};
  std::vector<Sighting> seen;
  for (const std::size_t c : {0U, 1U, 2U, 4U, 5U}) {
    seen.push_back({frame.coils[c].position_mm, 0});
  }
  seen.push_back({Vector3d(70, 70, 70), 0});
  const Naming naming = name_coils(frame, on, seen);
  ASSERT_EQ(naming.status, Naming::Status::kNamed);
  EXPECT_EQ(naming.coil.back(), -1);
  EXPECT_EQ(naming.missing, std::vector<int>{3});
  EXPECT_EQ(name_coils(frame, on, std::span(seen).first(3)).status, Naming::Status::kTooFew);
}

TEST(RobotRegistration, AnArtefactAtACoilThatWasOffNamesTheCable) {
  const CoilFrame frame = small_frame();
  const Stack background = drawn({}, 0, 1);
  const Stack foreground = drawn(places(frame, {0, 1, 2, 3, 5}, kPlaced), 6.0, 2);
  CoilScan scan{"a", &background, &foreground, nullptr, {0, 1, 2, 4, 5}}; // b1 carries the current of b2
  const RobotRegistration r = register_robot(frame, std::span(&scan, 1), undistorted());
  ASSERT_EQ(r.verdict, RegistrationVerdict::kFound) << r.reason;
  EXPECT_TRUE(mentions(r.notes, "b1 carries current though it was not switched on"));
  EXPECT_TRUE(mentions(r.notes, "b2 is missing"));
  EXPECT_LT((r.T_base_device.pose.translation() - kPlaced.inverse().translation()).norm(), 0.5);
}

TEST(RobotRegistration, RefusesMixedOrientationsAndTooFewCoils) {
  const CoilFrame frame = small_frame();
  const Stack background = drawn({}, 0, 1);
  const Stack foreground = drawn(places(frame, {0, 1, 2}, kPlaced), 6.0, 2);
  const CoilScan a{"a", &background, &foreground, nullptr, {0, 1, 2}};
  const RobotRegistration few = register_robot(frame, std::span(&a, 1), undistorted());
  EXPECT_EQ(few.verdict, RegistrationVerdict::kRefused);
  EXPECT_NE(few.reason.find("fewer than four"), std::string::npos) << few.reason;

  Stack turned_background = background, turned_foreground = foreground;
  for (Stack *stack : {&turned_background, &turned_foreground}) {
    stack->T_image_index.col(1).swap(stack->T_image_index.col(2));
  }
  const std::vector<CoilScan> mixed{a, {"b", &turned_background, &turned_foreground, nullptr, {3, 4, 5}}};
  const RobotRegistration r = register_robot(frame, mixed, undistorted());
  EXPECT_EQ(r.verdict, RegistrationVerdict::kRefused);
  EXPECT_NE(r.reason.find("another orientation"), std::string::npos) << r.reason;
}

TEST(RobotRegistration, AFrameThatLiesOtherwiseThanMountedIsRefused) {
  const CoilFrame frame = small_frame();
  const Stack background = drawn({}, 0, 1);
  const Stack foreground = drawn(places(frame, {0, 1, 2, 3, 4, 5}, kPlaced), 6.0, 2);
  const CoilScan scan{"all", &background, &foreground, nullptr, {0, 1, 2, 3, 4, 5}};
  RobotRegistrationOptions options = undistorted();
  options.expected_rotation = geometry::rotation_exp(Vector3d(0, M_PI, 0));
  const RobotRegistration r = register_robot(frame, std::span(&scan, 1), options);
  EXPECT_EQ(r.verdict, RegistrationVerdict::kRefused);
  EXPECT_NE(r.reason.find("from where it is mounted"), std::string::npos) << r.reason;
  options.limit_mm = 0.01;
  options.expected_rotation.reset();
  EXPECT_EQ(register_robot(frame, std::span(&scan, 1), options).verdict, RegistrationVerdict::kInaccurate);
}

namespace {

// Five coils that verify, drawn from the errors that they state; and together off by offset_mm.
struct VerifyingDraw {
  CoilFrame frame = drawn_frame();
  geometry::UncertainPose<frame::Base, frame::Device> T;
  std::vector<LocatedCoil> coils;

  VerifyingDraw(std::uint64_t seed, const Vector3d &offset_mm) {
    constexpr double kPose_mm = 0.08, kField_mm = 0.05, kFound_mm = 0.16;
    sim::Random random(seed, "verify");
    T.covariance.diagonal() << 1e-8, 1e-8, 1e-8, Vector3d::Constant(kPose_mm * kPose_mm);
    const Vector3d common = random.normal3(kPose_mm) + random.normal3(kField_mm) + offset_mm;
    for (const int coil : coils_of(frame, {"tree"})) {
      LocatedCoil located;
      located.coil = coil;
      located.position_mm = frame.coils[static_cast<std::size_t>(coil)].position_mm + common +
                            random.normal3(frame.build_sigma_mm) + random.normal3(kFound_mm);
      located.field_sigma_mm = Vector3d::Constant(kField_mm);
      located.covariance = (kFound_mm * kFound_mm + kField_mm * kField_mm) * Eigen::Matrix3d::Identity();
      coils.push_back(located);
    }
  }
  [[nodiscard]] Verification verified() const {
    return verify_registration(frame, coils, 5, T, {}, Eigen::Matrix3d::Identity(), {});
  }
};

} // namespace

TEST(Verification, PassesCoilsWithinTheirStatedErrorsAndFindsACommonOffset) {
  constexpr int kRuns = 400;
  int failed = 0, noticed = 0;
  double unexplained = 0.0;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    const Verification good = VerifyingDraw(seed, Vector3d::Zero()).verified();
    failed += good.failure.empty() ? 0 : 1;
    unexplained += good.unexplained.trace() / kRuns;
    const Verification off = VerifyingDraw(seed, {0.75, 0.0, 0.0}).verified();
    noticed += off.failure.empty() ? 0 : 1;
    if (off.failure.empty()) { // then it is in what is not explained
      EXPECT_GT(off.unexplained(0, 0), 0.05) << seed;
    }
  }
  EXPECT_LE(failed, 3) << "of " << kRuns;
  EXPECT_LT(unexplained, 0.15) << "mm^2, from five coils alone";
  EXPECT_GE(noticed, kRuns * 9 / 10);
  const Verification off = VerifyingDraw(1, {0.0, 2.0, 0.0}).verified();
  EXPECT_NEAR(off.offset_mm.y(), 2.0, 0.4);
  EXPECT_NE(off.failure.find("has entered the bore"), std::string::npos) << off.failure;
}

// B0 that differs from coil to coil has no common offset: its scatter along the rows is stated.
TEST(Verification, ScatterAlongARowIsAddedToTheCovarianceOfThePose) {
  VerifyingDraw draw(4, Vector3d::Zero());
  for (std::size_t i = 0; i < draw.coils.size(); ++i) {
    LocatedCoil &coil = draw.coils[i];
    coil.position_mm = draw.frame.coils[static_cast<std::size_t>(coil.coil)].position_mm;
    coil.position_mm.x() += i % 2 == 0 ? 0.4 : -0.6; // mean 0
  }
  const Verification v = draw.verified();
  EXPECT_TRUE(v.failure.empty()) << v.failure;
  EXPECT_GT(v.unexplained(0, 0), 0.2);
  EXPECT_NEAR(v.unexplained(1, 1), 0.0, 1e-9);
  EXPECT_NEAR(v.unexplained(2, 2), 0.0, 1e-9);
  // The coils of the fit count too: eight that agree say that there is less of it.
  std::vector<LocatedCoil> fitted;
  for (const int number : coils_of(draw.frame, {"mid-top", "mid-bottom"})) {
    LocatedCoil coil = draw.coils.front();
    coil.coil = number;
    coil.position_mm = draw.frame.coils[static_cast<std::size_t>(number)].position_mm;
    coil.used = true;
    fitted.push_back(coil);
  }
  const Verification less =
      verify_registration(draw.frame, draw.coils, 5, draw.T, fitted, Eigen::Matrix3d::Identity(), {});
  EXPECT_LT(less.unexplained(0, 0), 0.5 * v.unexplained(0, 0));
}

// Opposed read-outs show B0 at each coil; what it was when it was mapped is subtracted.
TEST(Verification, AB0ThatChangedSinceItWasMappedIsStatedForImagesOfOneReadOut) {
  VerifyingDraw draw(5, Vector3d::Zero());
  for (LocatedCoil &coil : draw.coils) {
    coil.used = true;
    coil.b0_mm = Vector3d(0.5 + 0.01 * coil.position_mm.x(), 0.0, 0.0);
  }
  const auto change = [&](const MappedB0 &mapped) { return b0_change(draw.coils, {}, draw.T.pose, mapped); };
  EXPECT_TRUE(std::isnan(change({}).max_mm)) << "what was mapped is not known";
  const MappedB0 mapped = [](const Vector3d &p) -> Vector3d { return {0.01 * p.x(), 0.0, 0.0}; };
  EXPECT_NEAR(change(mapped).second_moment(0, 0), 0.25, 1e-9);
  EXPECT_NEAR(change(mapped).max_mm, 0.5, 1e-9);
  draw.coils.front().b0_mm.setConstant(std::nan("")); // one that a single read-out shows
  EXPECT_NEAR(change(mapped).second_moment(0, 0), 0.25, 1e-9);
}

TEST(Verification, AMeanIsNotBetterThanWhatIsCommonToItsCoils) {
  VerifyingDraw draw(3, Vector3d::Zero());
  for (LocatedCoil &coil : draw.coils) {
    coil.field_sigma_mm = Vector3d::Constant(1.0);
    coil.covariance += Eigen::Matrix3d::Identity();
    coil.position_mm.x() += 1.5;
  }
  const Verification v = draw.verified();
  EXPECT_TRUE(v.failure.empty()) << v.failure; // 1.5 sigma of the field
  EXPECT_GE(v.offset_covariance(0, 0), 1.0);
}

TEST(Verification, TooFewCoilsAndALargeErrorAreRefused) {
  VerifyingDraw draw(1, Vector3d::Zero());
  draw.coils.resize(2);
  EXPECT_EQ(draw.verified().failure, "2 of 5 coils are where the registration expects them");
  const Verification far = VerifyingDraw(1, {0.0, 0.0, 4.0}).verified();
  EXPECT_NE(far.failure.find("from where the registration expects them"), std::string::npos) << far.failure;
}

// Of a registration's own scans too: coils that verify and do not confirm it refuse it.
TEST(RobotRegistration, CoilsThatVerifyRefuseWhatTheyDoNotConfirm) {
  CoilFrame frame = small_frame();
  frame.coils.push_back({"v1", "v", {-10, 30, -5}});
  frame.coils.push_back({"v2", "v", {25, -15, 5}});
  frame.coils.push_back({"v3", "v", {-25, -20, 0}});
  const Stack background = drawn({}, 0, 1);
  for (const double offset_mm : {0.0, 1.5}) {
    std::vector<Vector3d> shown = places(frame, {0, 1, 2, 3, 4, 5, 6, 7, 8}, kPlaced);
    for (std::size_t i = 6; i < shown.size(); ++i) {
      shown[i].x() += offset_mm;
    }
    const Stack foreground = drawn(shown, 6.0, 2);
    const CoilScan scan{"all", &background, &foreground, nullptr, {0, 1, 2, 3, 4, 5, 6, 7, 8}, {6, 7, 8}};
    const RobotRegistration r = register_robot(frame, std::span(&scan, 1), undistorted());
    EXPECT_EQ(r.verified.size(), 3U);
    if (offset_mm == 0.0) {
      EXPECT_EQ(r.verdict, RegistrationVerdict::kFound) << r.reason;
    } else {
      EXPECT_EQ(r.verdict, RegistrationVerdict::kInconsistent);
      EXPECT_NE(r.reason.find("that verify are together"), std::string::npos) << r.reason;
    }
  }
}

TEST(RobotRegistration, TheBaseOfEachSliceFollowsFromOneTransform) {
  const Rigid3<frame::Base, frame::Device> T_base_device = kPlaced.inverse();
  SliceHeader header;
  header.rows = header.columns = 192;
  header.row_spacing_mm = header.column_spacing_mm = 1.5625;
  header.along_column = -Vector3d::UnitZ();
  header.position_mm = Vector3d(-150, 20, 150);
  const auto first = SlicePlane::from(header);
  header.position_mm.y() += 1.5;
  const auto second = SlicePlane::from(header);
  ASSERT_TRUE(first && second);
  const auto a = T_base_slice(T_base_device, *first), b = T_base_slice(T_base_device, *second);
  EXPECT_NEAR((a.translation() - b.translation()).norm(), 1.5, 1e-9); // differs by the distance of the slices
  // The same point of Patient through either slice.
  const Vector3d point(12, 20.7, -31);
  EXPECT_LT(
      (a * (first->T_patient_slice().inverse() * point) - b * (second->T_patient_slice().inverse() * point)).norm(),
      1e-9);
}

} // namespace bregma::mri::test
