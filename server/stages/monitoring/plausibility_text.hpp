// Texts of the alarms about implausible bodies: names, reason, and the field with its value.
#pragma once

#include <string_view>

#include "server/stages/plausibility/body_judge.hpp"

namespace bregma::server {

struct BodyName {
  std::string_view tracker;
  std::string_view body;
  bool is_reference;
};

// "Stylus of Tracker is refused: it moved as no hand can (statistic 812, limit 36)", and how the verdict ends. No
// allocation.
void describe(const BodyReport &report, const BodyName &name, char (&text)[256]) noexcept;

} // namespace bregma::server
