// Violations that are known and not mended yet: tests/faults/known_failures.txt. Each run prints those that it meets
// with their reason. An entry that no run meets any more is an error: it must be removed.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tests/faults/cell.hpp"
#include "tests/faults/judge.hpp"

namespace bregma::faults {

struct KnownFailure {
  std::string cell;              // the begin of its name; empty: every cell
  std::optional<During> session; // empty: every session
  std::string rule;
  std::string reason;
};

// Read once. Throws std::runtime_error for a line that is no entry.
[[nodiscard]] const std::vector<KnownFailure> &known_failures();
// The entry with the longest name of a cell; nullptr: the violation is not known.
[[nodiscard]] const KnownFailure *find_known(const Cell &cell, During session, const Violation &violation);

} // namespace bregma::faults
