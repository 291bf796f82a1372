// The deformation pipeline with the builder's model of a small case.
#include "server/stages/deformation/pipeline.hpp"

#include <cmath>
#include <memory>
#include <string_view>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "server/stages/tissue_model/tissue_builder.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace bregma::server {
namespace {

constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;
constexpr std::int64_t kPeriod_ns = 16'666'667;
constexpr int kSteps = 1000; // more than needed

class Deformation : public testing::Test {
protected:
  Deformation() {
    casefile::Case data = tests::sample_case("/cases/sample");
    data.targets.push_back({"In the neck", {0, 0, -88}}); // not in the brain
    case_ = std::make_unique<LoadedCase>(std::make_shared<const casefile::Case>(std::move(data)), 12.0, 100);
    pipeline_.handle(CaseChanged{1, case_.get()});
  }

  void build(int elements) {
    TissueSettings settings;
    settings.model_wanted = elements > 0;
    settings.brain.mesh.lattice.tetrahedra = elements;
    builder_ = std::make_unique<TissueBuilder>(settings);
    builder_->handle(CaseChanged{1, case_.get()});
    const auto ready = builder_->build();
    ASSERT_TRUE(ready);
    pipeline_.handle(*ready);
  }

  // The tip at this distance before the target on the planned line.
  ProbeView probe_at(double before_mm) const {
    const auto &plan = case_->data->trajectories.front();
    const Vector3d shaft = (plan.entry_mm - plan.target_mm).normalized();
    ProbeView out;
    out.live = true;
    out.acquired_ns = now_ns_;
    out.valid_until_ns = now_ns_ + 3 * kPeriod_ns;
    Vector3d::Map(out.tip_mm) = plan.target_mm + before_mm * shaft;
    Vector3d::Map(out.shaft) = shaft;
    Vector3d::Map(out.shaft_in_tool) = Vector3d::UnitX();
    return out;
  }

  const wire::DeformationState &step(const ProbeView &probe, const ForceView &force = {}) {
    now_ns_ += kPeriod_ns;
    ProbeView seen = probe;
    seen.acquired_ns += kPeriod_ns;
    pipeline_.step(seen, force, now_ns_, kSteps);
    return pipeline_.states().front();
  }

  std::unique_ptr<LoadedCase> case_;
  std::unique_ptr<TissueBuilder> builder_;
  DeformationPipeline pipeline_;
  std::int64_t now_ns_ = kStart_ns;
};

TEST_F(Deformation, WithoutAModelItReportsTheReasonAndNoPrediction) {
  const auto &building = step(probe_at(0.0));
  EXPECT_EQ(building.status, bregma_wire_DEFORMATION_NO_MODEL);
  EXPECT_EQ(building.reason, bregma_wire_DEFORMATION_REASON_BUILDING);
  EXPECT_EQ(Vector3d::Map(building.imaged_mm), Vector3d(10, -5, 20));
  EXPECT_TRUE(std::isnan(building.displaced_mm[0]) && std::isnan(building.tip_force_N));

  pipeline_.handle(TissueModelReady{7, nullptr});
  EXPECT_EQ(step(probe_at(0.0)).reason, bregma_wire_DEFORMATION_REASON_BUILDING) << "another case's model";
  build(0);
  EXPECT_EQ(builder_->why(), "deformation.elements is 0");
  EXPECT_EQ(step(probe_at(0.0)).reason, bregma_wire_DEFORMATION_REASON_REFUSED);
  EXPECT_EQ(pipeline_.predicted().status[0], bregma_wire_DEFORMATION_NO_MODEL);
}

TEST_F(Deformation, ACaseWithoutABrainHasNoModelAndSaysSo) {
  casefile::Case data = *case_->data;
  data.brain = {};
  data.brain_landmarks.clear();
  case_ = std::make_unique<LoadedCase>(std::make_shared<const casefile::Case>(std::move(data)), 12.0, 100);
  pipeline_.handle(CaseChanged{1, case_.get()});
  build(2000);
  EXPECT_EQ(builder_->why(), "no tissue model: the case has no brain");
  const auto &state = step(probe_at(0.0));
  EXPECT_EQ(state.status, bregma_wire_DEFORMATION_NO_MODEL);
  EXPECT_EQ(state.reason, bregma_wire_DEFORMATION_REASON_REFUSED);
}

TEST_F(Deformation, ABrainThatCannotBeMeshedIsRefusedWithItsFile) {
  casefile::Case data = *case_->data;
  data.brain.mesh.triangles.resize(20); // not closed
  case_ = std::make_unique<LoadedCase>(std::make_shared<const casefile::Case>(std::move(data)), 12.0, 100);
  build(2000);
  EXPECT_NE(builder_->why().find("/cases/sample: the brain's surface"), std::string::npos) << builder_->why();
  EXPECT_EQ(step(probe_at(0.0)).reason, bregma_wire_DEFORMATION_REASON_REFUSED);
}

TEST_F(Deformation, AnInsertionMovesTheTargetThroughItsPhases) {
  build(3000);
  bool indented = false;
  double furthest_mm = 0.0;
  for (double before_mm = 75.0; before_mm > 5.0; before_mm -= 0.15) { // 9 mm/s
    const auto &state = step(probe_at(before_mm));
    indented = indented || (state.phase == bregma_wire_PROBE_INDENTATION && state.ruptures == 0);
    if (state.status == bregma_wire_DEFORMATION_INVALID) {
      ASSERT_TRUE(std::isnan(state.displaced_mm[0]));
      continue;
    }
    const double moved_mm = (Vector3d::Map(state.displaced_mm) - Vector3d::Map(state.imaged_mm)).norm();
    ASSERT_LT(moved_mm, 20.0);
    furthest_mm = std::max(furthest_mm, moved_mm);
    ASSERT_EQ(pipeline_.predicted().position_mm[0][1], state.displaced_mm[1]);
  }
  const auto &state = pipeline_.states().front();
  EXPECT_TRUE(indented);
  EXPECT_EQ(state.phase, bregma_wire_PROBE_PENETRATION);
  EXPECT_EQ(state.ruptures, 1U);
  EXPECT_NEAR(state.rupture_force_N, 0.12, 0.03);
  EXPECT_GT(furthest_mm, 0.02);
  const auto &neck = pipeline_.states()[1];
  EXPECT_EQ(wire::view(neck.point), "In the neck");
  EXPECT_EQ(neck.status, bregma_wire_DEFORMATION_INVALID);
  EXPECT_EQ(neck.reason, bregma_wire_DEFORMATION_REASON_POINT_OUTSIDE);
  ASSERT_EQ(pipeline_.states().size(), 3U);
  const auto &commissure = pipeline_.states()[2];
  EXPECT_EQ(wire::view(commissure.point), "Anterior commissure");
  EXPECT_EQ(commissure.kind, bregma_wire_FOLLOWED_LANDMARK);
  EXPECT_NE(commissure.status, bregma_wire_DEFORMATION_INVALID);
  const double landmark_moved_mm =
      (Vector3d::Map(commissure.displaced_mm) - Vector3d::Map(commissure.imaged_mm)).norm();
  EXPECT_GT(landmark_moved_mm, 0.001);
  EXPECT_LT(landmark_moved_mm, 5.0);

  ProbeView lost = probe_at(5.0);
  lost.live = false;
  wire::DeformationState unseen{};
  for (int i = 0; i < 10; ++i) {
    unseen = step(lost);
  }
  EXPECT_NE(unseen.status, bregma_wire_DEFORMATION_VALID);
  EXPECT_EQ(unseen.reason, bregma_wire_DEFORMATION_REASON_PROBE_NOT_SEEN);
  pipeline_.handle(CaseChanged{2, nullptr});
  EXPECT_TRUE(pipeline_.states().empty());
}

TEST_F(Deformation, TheForceIsTheAxialComponentOfARecentSample) {
  build(2000);
  ForceView force;
  Vector3d::Map(force.force_N) = Vector3d(0.07, 5.0, -3.0); // the probe's body: x is up the shaft
  force.acquired_ns = now_ns_;
  EXPECT_NEAR(step(probe_at(60.0), force).measured_force_N, 0.07, 1e-12);
  now_ns_ += 100'000'000;
  EXPECT_TRUE(std::isnan(step(probe_at(60.0), force).measured_force_N)) << "a tenth of a second old";
  force.acquired_ns = now_ns_;
  ProbeView hidden = probe_at(60.0);
  hidden.live = false;
  EXPECT_TRUE(std::isnan(step(hidden, force).measured_force_N)) << "the direction of the shaft is unknown";
}

TEST_F(Deformation, APoseThatIsTooOldToMeasureWithIsNotUsed) {
  build(2000);
  ForceView force;
  force.acquired_ns = now_ns_ + kPeriod_ns;
  EXPECT_FALSE(std::isnan(step(probe_at(60.0), force).measured_force_N));
  force.acquired_ns = now_ns_ + kPeriod_ns;
  ProbeView old = probe_at(60.0);
  old.valid_until_ns = now_ns_ + kPeriod_ns - 1;
  EXPECT_TRUE(std::isnan(step(old, force).measured_force_N));
}

} // namespace
} // namespace bregma::server
