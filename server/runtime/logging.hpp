// The daemon's log: spdlog to the console and to a file, written by a separate thread.
//
// Nothing waits for a reader of the console: lines that do not fit are dropped, and their number is logged. Names and
// texts from the wire are part of many lines, so control characters and invalid UTF-8 are written as \x1b.
//
// Loops never log, because even spdlog's asynchronous queue takes a mutex. They count events, and other threads report
// the counts.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "base/result.hpp"

namespace bregma::runtime {

struct LogOptions {
  std::string level = "info"; // trace, debug, info, warn, error, critical, off
  std::filesystem::path file; // rotated at 10 MB, five files are kept; empty: console only
  bool console = true;        // standard error
};

// Creates the default logger, used by spdlog::info and the others. Call it once, before other threads log.
[[nodiscard]] base::Result<void> start_logging(const LogOptions &options);
// Writes the queued lines and ends the log's thread. May wait for the disk of the log file.
void stop_logging();

// Text with control characters and invalid UTF-8 as \x1b, so that it stays on its line and does not control a terminal.
[[nodiscard]] std::string escaped(std::string_view text);

} // namespace bregma::runtime
