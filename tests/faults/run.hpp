// One run: a cell of the matrix in one session, with one seed, in virtual time.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/faults/cell.hpp"
#include "tests/faults/judge.hpp"
#include "tests/faults/sessions.hpp"

namespace bregma::faults {

struct Outcome {
  std::vector<Violation> violations;
  Figures figures;
  double virtual_s = 0.0;
  [[nodiscard]] bool holds() const { return violations.empty(); }
};

// The seed of the faults in this run. The patient and the devices' noise are those of Sessions::kPatientSeed.
[[nodiscard]] std::uint64_t seed_of(const Cell &cell, During session);

[[nodiscard]] Outcome run(const Sessions &sessions, const Cell &cell, During session);

} // namespace bregma::faults
