// What the readers of Slicer's two formats have in common: names of the coordinate systems, and what is left out or
// assumed (Notes, markups.hpp).
#pragma once

#include <optional>
#include <string>

#include "base/result.hpp"
#include "casefile/markups.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

// Names since Slicer 4.11; numbers of MRML before that: RAS = 0, LPS = 1.
[[nodiscard]] inline std::optional<Space> space_of(const std::string &text) {
  return text == "1" ? Space::kLps : text == "0" ? Space::kRas : space_named(text);
}

// Keeps a note, or refuses the file where no notes are kept.
[[nodiscard]] inline base::Result<void> leave_out(const std::string &sentence, const char *remedy, Notes *notes) {
  if (notes == nullptr) {
    return base::failure(sentence + remedy);
  }
  notes->push_back(sentence + ": it is left out");
  return {};
}

// Remedy for a point without a position.
inline constexpr const char *kPlaceIt = ": place it, or delete it";

// What a file does not state: kept as a note, or the file is refused where no notes are kept.
[[nodiscard]] inline base::Result<void> assume(const std::string &sentence, const std::string &assumed, Notes *notes) {
  if (notes == nullptr) {
    return base::failure(sentence + ": state it");
  }
  notes->push_back(sentence + ": " + assumed + " is assumed");
  return {};
}

} // namespace bregma::casefile
