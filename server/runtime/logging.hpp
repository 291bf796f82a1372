// The daemon's log: spdlog to the console and to a file, written by a separate thread.
//
// Loops never log, because even spdlog's asynchronous queue takes a mutex. They count events, and other threads report
// the counts.
#pragma once

#include <filesystem>
#include <string>

#include "base/result.hpp"

namespace bregma::runtime {

struct LogOptions {
  std::string level = "info"; // trace, debug, info, warn, error, critical, off
  std::filesystem::path file; // rotated at 10 MB, five files are kept; empty: console only
  bool console = true;        // standard error
};

// Creates the default logger, used by spdlog::info and the others. Call it once, before other threads log.
[[nodiscard]] base::Result<void> start_logging(const LogOptions &options);
// Writes the queued lines and ends the log's thread.
void stop_logging();

} // namespace bregma::runtime
