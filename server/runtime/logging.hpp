// The daemon's log: spdlog to the console and to a file, written by a thread of its own.
//
// Loops never log: even spdlog's asynchronous queue takes a mutex. They count, and others report the counts.
#pragma once

#include <filesystem>
#include <string>

#include "base/result.hpp"

namespace bregma::runtime {

struct LogOptions {
  std::string level = "info"; // trace, debug, info, warn, error, critical, off
  std::filesystem::path file; // rotated at 10 MB, five kept; empty: console alone
  bool console = true;        // standard error
};

// Makes the default logger; spdlog::info and its like go there. Call once, before other threads log.
[[nodiscard]] base::Result<void> start_logging(const LogOptions &options);
// Writes what is queued and ends the log's thread.
void stop_logging();

} // namespace bregma::runtime
