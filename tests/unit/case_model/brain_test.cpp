#include "case_model/brain.hpp"

#include <stdexcept>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "tests/unit/casefile/sample_case.hpp"

namespace {

using namespace bregma::case_model;
using namespace bregma::casefile;
using bregma::surface::SurfaceModel;
using bregma::tests::sample_case;
using bregma::tissue::named_material;
using Eigen::Vector3d;

TEST(CaseTissue, WithoutATableTheFirstTrajectorysEntryIsOpen) {
  const Case c = sample_case("somewhere");
  const auto craniotomy = craniotomy_of(c, SurfaceModel(c.brain.mesh), kCraniotomyRadius_mm);
  EXPECT_EQ(craniotomy.radius_mm, 15.0);
  const Vector3d centre = craniotomy.centre_mm;
  EXPECT_NEAR((centre - Vector3d(0, 0, 5)).norm(), 70.0, 0.5) << "on the brain, a coarse ball";
  const Vector3d along = (c.trajectories[0].target_mm - c.trajectories[0].entry_mm).normalized();
  EXPECT_LT(along.cross(centre - c.trajectories[0].entry_mm).norm(), 0.01) << "on the planned line";
}

TEST(CaseTissue, TheCentreIsATrajectorysEntryOrAPoint) {
  Case c = sample_case("somewhere");
  const SurfaceModel brain(c.brain.mesh);
  c.trajectories.push_back({"Other", {90, 0, 5}, {10, 0, 5}});
  c.craniotomy = {.trajectory = "Other", .radius_mm = 9.0};
  auto craniotomy = craniotomy_of(c, brain, kCraniotomyRadius_mm);
  EXPECT_EQ(craniotomy.radius_mm, 9.0);
  EXPECT_LT((craniotomy.centre_mm - Vector3d(70, 0, 5)).norm(), 0.01);

  c.craniotomy = {.trajectory = "", .centre_mm = {0, 0, 88}, .radius_mm = std::nullopt};
  craniotomy = craniotomy_of(c, brain, 12.0);
  EXPECT_EQ(craniotomy.radius_mm, 12.0) << "the table does not say";
  EXPECT_LT((craniotomy.centre_mm - Vector3d(0, 0, 75)).norm(), 0.01) << "from the bone to the brain";
}

TEST(CaseTissue, ATrajectoryThatMissesTheBrainOpensTheSkullAtItsEntry) {
  Case c = sample_case("somewhere");
  c.trajectories[0] = {"Beside", {0, 0, 88}, {60, 0, 88}};
  const auto craniotomy = craniotomy_of(c, SurfaceModel(c.brain.mesh), 15.0);
  EXPECT_LT((craniotomy.centre_mm - Vector3d(0, 0, 75)).norm(), 0.01);
}

TEST(CaseTissue, RadiusZeroOrNoTrajectoryIsNoCraniotomy) {
  Case c = sample_case("somewhere");
  const SurfaceModel brain(c.brain.mesh);
  EXPECT_EQ(craniotomy_of(c, brain, 0.0).radius_mm, 0.0);
  c.craniotomy = {.trajectory = "Biopsy", .radius_mm = 0.0};
  EXPECT_EQ(craniotomy_of(c, brain, 15.0).radius_mm, 0.0);
  c.craniotomy.reset();
  c.trajectories.clear();
  EXPECT_EQ(craniotomy_of(c, brain, 15.0).radius_mm, 0.0);
}

TEST(CaseTissue, TheCaseReplacesValuesOfTheNamedMaterial) {
  Case c = sample_case("somewhere");
  EXPECT_EQ(material_of(c, named_material("linear")).name, "linear");
  c.tissue = {.material = "miller-chinzei",
              .young_Pa = std::nullopt,
              .poisson = 0.48,
              .density_kg_m3 = 1040.0,
              .ogden_alpha = std::nullopt};
  const auto material = material_of(c, named_material("linear"));
  const auto &plain = named_material("miller-chinzei");
  EXPECT_EQ(material.name, "miller-chinzei");
  EXPECT_EQ(material.young_Pa, plain.young_Pa);
  EXPECT_EQ(material.poisson, 0.48);
  EXPECT_EQ(material.density_kg_m3, 1040.0);
  EXPECT_EQ(material.prony.size(), 2U);
  EXPECT_EQ(material.source, plain.source + "; of the case: poisson, density_kg_m3");
  c.tissue->material = "jelly";
  EXPECT_THROW((void)material_of(c, plain), std::invalid_argument);
}

} // namespace
