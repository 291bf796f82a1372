// Materials of soft tissue: hyperelastic laws, nearly incompressible, with Prony relaxation of the shear part.
//
//   W = W_iso(F J^(-1/3)) + kappa / 2 (J - 1)^2
//
// neo-Hookean   W_iso = mu / 2 (I1 - 3)
// Ogden, N = 1  W_iso = 2 mu / alpha^2 (l1^alpha + l2^alpha + l3^alpha - 3)     [Miller 2002] (brain)
// linear        Hooke's law in the small strain: for comparison, wrong under rotation
//
// Relaxation: mu(t) = mu (1 - sum g_k (1 - exp(-t / tau_k))); E and mu are the instantaneous ones. The pressure does
// not relax. SI throughout.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace bregma::tissue {

enum class Law { kNeoHookean, kOgden, kLinear };

struct PronyTerm {
  double fraction = 0.0; // g, relative to the instantaneous shear modulus
  double time_s = 1.0;   // tau
};

struct Material {
  std::string name;
  Law law = Law::kNeoHookean;
  double young_Pa = 2100.0;
  double poisson = 0.45;
  double density_kg_m3 = 1000.0;
  double ogden_alpha = 2.0;     // 2 is neo-Hookean
  std::vector<PronyTerm> prony; // empty: elastic
  std::string source;           // origin of the parameters

  [[nodiscard]] double shear_Pa() const { return young_Pa / (2.0 * (1.0 + poisson)); }
  [[nodiscard]] double bulk_Pa() const { return young_Pa / (3.0 * (1.0 - 2.0 * poisson)); }
  [[nodiscard]] double wave_modulus_Pa() const { return bulk_Pa() + 4.0 / 3.0 * shear_Pa(); }
  [[nodiscard]] double relaxed_fraction() const; // 1 - sum g: fraction of the shear modulus after all relaxation
};

// Throws std::invalid_argument with the parameter's name and value.
void check(const Material &material);

// The named sets, the first of them the default: "thesis", "miller-chinzei", "linear".
[[nodiscard]] std::span<const Material> named_materials();
// Throws std::invalid_argument that lists the names.
[[nodiscard]] const Material &named_material(std::string_view name);

} // namespace bregma::tissue
