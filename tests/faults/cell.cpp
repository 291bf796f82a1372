#include "tests/faults/cell.hpp"

namespace bregma::faults {

const char *name_of(Subject subject) {
  static constexpr const char *kNames[] = {
      "nothing",     "tracker", "robot",  "force", "range", "arm",    "arm beside tracker",
      "scan sensor", "client",  "daemon", "disk",  "clock", "network"};
  return kNames[static_cast<std::size_t>(subject)];
}

const char *name_of(Fault fault) {
  static constexpr const char *kNames[] = {"none",      "silent",     "late",    "reordered",  "duplicated",
                                           "frozen",    "not finite", "jumping", "wrong tool", "clock step",
                                           "restarted", "malformed",  "flooded"};
  return kNames[static_cast<std::size_t>(fault)];
}

const char *name_of(During session) {
  static constexpr const char *kNames[] = {"idle",     "case loaded", "registering", "registered",
                                           "verified", "navigating",  "degraded"};
  return kNames[static_cast<std::size_t>(session)];
}

std::string Cell::name() const {
  return std::string(name_of(subject)) + "/" + name_of(fault) + (variant.empty() ? "" : ": " + variant);
}

} // namespace bregma::faults
