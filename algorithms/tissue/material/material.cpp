#include "algorithms/tissue/material/material.hpp"

#include <cmath>
#include <stdexcept>

namespace bregma::tissue {

double Material::relaxed_fraction() const {
  double fraction = 1.0;
  for (const PronyTerm &term : prony) {
    fraction -= term.fraction;
  }
  return fraction;
}

void check(const Material &material) {
  const auto refuse = [&](const char *what, double value, const char *need) {
    throw std::invalid_argument("material '" + material.name + "': " + what + " = " + std::to_string(value) +
                                ", must be " + need);
  };
  if (!(material.young_Pa > 0.0) || !std::isfinite(material.young_Pa)) {
    refuse("young_Pa", material.young_Pa, "positive");
  }
  if (!(material.poisson >= 0.0 && material.poisson < 0.5)) {
    refuse("poisson", material.poisson, "at least 0 and below 0.5");
  }
  if (!(material.density_kg_m3 > 0.0) || !std::isfinite(material.density_kg_m3)) {
    refuse("density_kg_m3", material.density_kg_m3, "positive");
  }
  if (material.law == Law::kOgden && (!std::isfinite(material.ogden_alpha) || material.ogden_alpha == 0.0)) {
    refuse("ogden_alpha", material.ogden_alpha, "finite and not 0");
  }
  for (const PronyTerm &term : material.prony) {
    if (!(term.fraction > 0.0)) {
      refuse("prony fraction", term.fraction, "positive");
    }
    if (!(term.time_s > 0.0) || !std::isfinite(term.time_s)) {
      refuse("prony time_s", term.time_s, "positive");
    }
  }
  if (!(material.relaxed_fraction() > 0.0)) {
    refuse("1 - sum of prony fractions", material.relaxed_fraction(), "positive");
  }
}

std::span<const Material> named_materials() {
  static const std::vector<Material> materials = [] {
    // Shear modulus 842 Pa at nu = 0.49.
    constexpr double kMillerPoisson = 0.49;
    constexpr double kMillerShear_Pa = 842.0;
    std::vector<Material> out(3);
    out[0].name = "thesis";
    out[0].source = "[thesis, section 6.3.1]: E, nu and density; its bulk and shear moduli contradict them and are not "
                    "used. Elastic: no viscous parameters are printed";
    out[1].name = "miller-chinzei";
    out[1].law = Law::kOgden;
    out[1].young_Pa = 2.0 * (1.0 + kMillerPoisson) * kMillerShear_Pa;
    out[1].poisson = kMillerPoisson;
    out[1].ogden_alpha = -4.7;
    out[1].prony = {{0.450, 0.5}, {0.365, 50.0}};
    out[1].source = "[Miller 2002], J Biomech 35 (2002): brain in tension and compression";
    out[2].name = "linear";
    out[2].law = Law::kLinear;
    out[2].source = "E, nu and density of [thesis, section 6.3.1] with Hooke's law, for comparison";
    return out;
  }();
  return materials;
}

const Material &named_material(std::string_view name) {
  std::string names;
  for (const Material &material : named_materials()) {
    if (material.name == name) {
      return material;
    }
    names += names.empty() ? material.name : ", " + material.name;
  }
  throw std::invalid_argument("no material '" + std::string(name) + "'; there are " + names);
}

} // namespace bregma::tissue
