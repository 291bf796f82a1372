// Sentences for the operator at the display.
#pragma once

#include <string>

#include "clients/live/snapshot.hpp"

namespace bregma::gateway {

// What to do next in the session; empty: nothing.
[[nodiscard]] std::string next_step_text(const live::Snapshot &snapshot);
// What is wrong with the connection to the daemon; empty: nothing.
[[nodiscard]] std::string link_text(const live::Snapshot &snapshot, bool alive);

} // namespace bregma::gateway
