// `bregma mri register --watch`: follows the registration of a scanner that a daemon guides.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

enum class WatchUntil {
  kDaemonEnds, // or Ctrl-C
  kOperator,   // the daemon waits for the operator (kOk)
  kAccepted    // the registration is accepted and valid (kOk)
};

// Prints the state whenever it changes (with --json: one object per line). A step that has failed ends it as well
// (kRefused), unless it lasts as long as the daemon.
[[nodiscard]] int watch_registration(WatchUntil until, const Context &context);

} // namespace bregma::cli
