#include "server/runtime/state_directory.hpp"

#include <cstdlib>

namespace bregma::runtime {

std::string state_directory(const std::string &configured) {
  const auto variable = [](const char *name) {
    const char *value = std::getenv(name);
    return std::string(value != nullptr ? value : "");
  };
  if (!configured.empty()) {
    return configured;
  }
  if (const std::string systemd = variable("STATE_DIRECTORY"); !systemd.empty()) {
    return systemd.substr(0, systemd.find(':')); // systemd lists several with colons; ours is the first
  }
  if (const std::string home = variable("XDG_STATE_HOME"); !home.empty()) {
    return home + "/bregma";
  }
  return variable("HOME") + "/.local/state/bregma";
}

} // namespace bregma::runtime
