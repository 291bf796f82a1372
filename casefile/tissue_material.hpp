// The material that a case's [tissue] table names. Safe from any thread.
#pragma once

#include "algorithms/tissue/material/material.hpp"
#include "casefile/case.hpp"

namespace bregma::casefile {

// The named material with the changes of the case, which its source states. Throws std::invalid_argument for a name
// that is not in the set, which a case that was loaded or checked does not have.
[[nodiscard]] tissue::Material material_of(const TissueChoice &choice);

} // namespace bregma::casefile
