// Parts of the texts in a session's answers.
#pragma once

#include <algorithm>
#include <cstdio>
#include <string>

#include "casefile/case.hpp"

namespace bregma::server {

[[nodiscard]] inline std::string mm(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f mm", value);
  return text;
}

// "A, B, C and 5 more", for items with names.
template <class Items> [[nodiscard]] std::string names_of(const Items &items) {
  constexpr std::size_t kShown = 8; // as many as fit a reply
  std::string out;
  for (std::size_t i = 0; i < std::min(items.size(), kShown); ++i) {
    out += (i == 0 ? "" : ", ") + items[i].name;
  }
  if (items.size() > kShown) {
    out += " and " + std::to_string(items.size() - kShown) + " more";
  }
  return out.empty() ? "none" : out;
}

// Answer for a name that the case does not contain.
template <class Items>
[[nodiscard]] std::string not_in_case(const casefile::Case &the_case, const char *what, const std::string &name,
                                      const Items &items) {
  return std::string(what) + " \"" + name + "\" is not in case " + the_case.id + "; it has " + names_of(items);
}

} // namespace bregma::server
