#include "server/stages/tissue_model/tissue_builder.hpp"

#include <gtest/gtest.h>

#include "tests/unit/casefile/sample_case.hpp"

namespace {

using namespace bregma;
using geometry::Vector3d;

server::TissueSettings small_model() {
  server::TissueSettings settings;
  settings.brain.mesh.lattice.tetrahedra = 2000;
  settings.brain.material = tissue::named_material("linear");
  settings.model.skull.sliding = false; // so that the surface outside the craniotomy is fixed
  return settings;
}

class BuiltTissue {
public:
  explicit BuiltTissue(casefile::Case c, const server::TissueSettings &settings = small_model())
      : loaded_(std::make_shared<const casefile::Case>(std::move(c)), 30.0, 100), builder_(settings) {
    builder_.handle({1, &loaded_});
    const auto ready = builder_.build();
    EXPECT_TRUE(ready && ready->model != nullptr) << builder_.why();
    model_ = ready ? ready->model : nullptr;
  }

  tissue::BrainModel &model() { return *model_; }

  // Whether the brain's surface near a point moves under a force.
  bool open_at(const Vector3d &place_mm) {
    tissue::ExplicitSolver &solver = model_->solver();
    int nearest = 0;
    double least = 1e9;
    for (const int node : model_->boundary().nodes) {
      const double distance = (solver.mesh().nodes_mm[static_cast<std::size_t>(node)] - place_mm).norm();
      if (distance < least) {
        least = distance;
        nearest = node;
      }
    }
    solver.reset();
    solver.set_force_N(nearest, {0.0, 0.0, -0.01});
    solver.advance(20);
    solver.clear_forces();
    return solver.displacement_mm(nearest).norm() > 0.0;
  }

private:
  server::LoadedCase loaded_;
  server::TissueBuilder builder_;
  tissue::BrainModel *model_ = nullptr;
};

TEST(TissueBuilder, WithoutTablesTheConfigurationApplies) {
  BuiltTissue built(tests::sample_case("somewhere"));
  EXPECT_EQ(built.model().solver().material().name, "linear");
  EXPECT_TRUE(built.open_at({2.0, 30.9, 67.8})) << "where the trajectory enters";
  EXPECT_FALSE(built.open_at({70.0, 0.0, 5.0}));
  EXPECT_FALSE(built.open_at({0.0, 0.0, -65.0}));
  ASSERT_EQ(built.model().points().size(), 2U) << "a target and a landmark";
  EXPECT_TRUE(built.model().points()[0].inside);
}

TEST(TissueBuilder, CraniotomyAndMaterialComeFromTheCase) {
  casefile::Case c = tests::sample_case("somewhere");
  c.craniotomy = {.trajectory = "", .centre_mm = {80.0, 0.0, 5.0}, .radius_mm = 25.0};
  c.tissue = {.material = "thesis",
              .young_Pa = 3000.0,
              .poisson = std::nullopt,
              .density_kg_m3 = std::nullopt,
              .ogden_alpha = std::nullopt};
  BuiltTissue built(c);
  EXPECT_EQ(built.model().solver().material().name, "thesis");
  EXPECT_EQ(built.model().solver().material().young_Pa, 3000.0);
  EXPECT_TRUE(built.open_at({70.0, 0.0, 5.0}));
  EXPECT_FALSE(built.open_at({2.0, 30.9, 67.8}));
}

TEST(TissueBuilder, TheConfiguredRadiusIsTheDefaultOfTheTable) {
  casefile::Case c = tests::sample_case("somewhere");
  c.craniotomy = {.trajectory = "Biopsy", .radius_mm = std::nullopt};
  server::TissueSettings settings = small_model();
  settings.brain.craniotomy_radius_mm = 0.0;
  EXPECT_FALSE(BuiltTissue(c, settings).open_at({2.0, 30.9, 67.8}));
  settings.brain.craniotomy_radius_mm = 25.0;
  EXPECT_TRUE(BuiltTissue(c, settings).open_at({2.0, 30.9, 67.8}));
}

} // namespace
