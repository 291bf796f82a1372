// bregmad: the stages (server/wiring.hpp) on their threads (server/loops.hpp) with their DDS topics, the recorder, and
// the main thread with signals and systemd on one Asio context.
#pragma once

#include <memory>
#include <string>

#include "server/config.hpp"

namespace bregma::server {

class Daemon {
public:
  // config_toml: the complete configuration as text, stored in every session file.
  // Throws dds::Error, std::invalid_argument for a configuration that check() refuses, or std::runtime_error if another
  // daemon uses the state directory.
  Daemon(const Config &config, std::string config_toml);
  ~Daemon();
  Daemon(const Daemon &) = delete;
  Daemon &operator=(const Daemon &) = delete;

  // Restores the last session, runs until SIGTERM or SIGINT, and ends cleanly within 2 s. If something hangs (a disk),
  // the process is ended then with status runtime::kEndedByLimit. Throws std::runtime_error if another daemon serves
  // the domain and there is no session to restore. Call it on the main thread.
  void run();

private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

} // namespace bregma::server
