#include "algorithms/tissue/material/material.hpp"

#include <functional>
#include <stdexcept>

#include <gtest/gtest.h>

namespace bregma::tissue {
namespace {

TEST(Material, EveryNamedSetIsOneThatTheSolverTakes) {
  for (const Material &material : named_materials()) {
    EXPECT_NO_THROW(check(material)) << material.name;
    EXPECT_FALSE(material.source.empty()) << material.name;
    EXPECT_EQ(named_material(material.name).name, material.name);
  }
}

TEST(Material, ModuliFollowFromYoungAndPoisson) {
  const Material &thesis = named_material("thesis");
  EXPECT_NEAR(thesis.shear_Pa(), 724.138, 0.001);
  EXPECT_NEAR(thesis.bulk_Pa(), 7000.0, 1e-9);
  EXPECT_NEAR(thesis.wave_modulus_Pa(), 7965.517, 0.001);
  const Material &miller = named_material("miller-chinzei");
  EXPECT_NEAR(miller.shear_Pa(), 842.0, 1e-9);
  EXPECT_NEAR(miller.relaxed_fraction(), 0.185, 1e-12);
}

TEST(Material, WhatIsWrongIsNamedWithItsValue) {
  const auto message = [](const std::function<void(Material &)> &spoil) {
    Material material = named_material("thesis");
    spoil(material);
    try {
      check(material);
    } catch (const std::invalid_argument &error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message([](Material &m) { m.young_Pa = -1.0; }),
            "material 'thesis': young_Pa = -1.000000, must be positive");
  EXPECT_EQ(message([](Material &m) { m.poisson = 0.5; }),
            "material 'thesis': poisson = 0.500000, must be at least 0 and below 0.5");
  EXPECT_NE(message([](Material &m) {
              m.prony = {{0.6, 1.0}, {0.5, 2.0}};
            }).find("sum of prony fractions"),
            std::string::npos);
  EXPECT_NE(message([](Material &m) { m.prony = {{0.6, 0.0}}; }).find("prony time_s = 0.0"), std::string::npos);
}

TEST(Material, AnUnknownNameIsAnsweredWithTheNames) {
  try {
    (void)named_material("jelly");
    FAIL();
  } catch (const std::invalid_argument &error) {
    EXPECT_STREQ(error.what(), "no material 'jelly'; there are thesis, miller-chinzei, linear");
  }
}

} // namespace
} // namespace bregma::tissue
