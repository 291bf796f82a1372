// Where a daemon keeps what a restart needs.
#pragma once

#include <string>

namespace bregma::runtime {

// configured, or when that is empty: $STATE_DIRECTORY (systemd; the first of several), $XDG_STATE_HOME/bregma,
// ~/.local/state/bregma. Not while another thread changes the environment.
[[nodiscard]] std::string state_directory(const std::string &configured);

} // namespace bregma::runtime
