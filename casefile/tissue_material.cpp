#include "casefile/tissue_material.hpp"

namespace bregma::casefile {

tissue::Material material_of(const TissueChoice &choice) {
  tissue::Material material = tissue::named_material(choice.material);
  std::string changed;
  const auto change = [&](const char *name, double &value, const std::optional<double> &to) {
    if (to) {
      value = *to;
      changed += (changed.empty() ? "" : ", ") + std::string(name);
    }
  };
  change("young_Pa", material.young_Pa, choice.young_Pa);
  change("poisson", material.poisson, choice.poisson);
  change("density_kg_m3", material.density_kg_m3, choice.density_kg_m3);
  change("ogden_alpha", material.ogden_alpha, choice.ogden_alpha);
  if (!changed.empty()) {
    material.source += "; of the case: " + changed;
  }
  return material;
}

} // namespace bregma::casefile
