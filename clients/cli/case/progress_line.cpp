#include "clients/cli/case/progress_line.hpp"

#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdio>

#include <unistd.h>

namespace bregma::cli {
namespace {

std::atomic<bool> stop_asked{false};
static_assert(std::atomic<bool>::is_always_lock_free); // may be set by a signal handler

void ask_to_stop(int) { stop_asked = true; }

} // namespace

ProgressLine::ProgressLine() : terminal_(::isatty(STDERR_FILENO) == 1) {
  std::signal(SIGINT, ask_to_stop);
  std::signal(SIGTERM, ask_to_stop);
}

ProgressLine::~ProgressLine() {
  if (terminal_ && !last_stage_.empty()) {
    std::fputs("\r\033[K", stderr);
  }
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

bool ProgressLine::show(double done, std::string_view stage) {
  const int percent = static_cast<int>(std::lround(100.0 * done));
  // "scalp: decimation" is one of many steps for the scalp. A log shows one line per surface.
  const std::string text(terminal_ ? stage : stage.substr(0, stage.find(':')));
  if (terminal_) {
    std::fprintf(stderr, "\r\033[K%3d %%  %s", percent, text.c_str());
    std::fflush(stderr);
  } else if (text != last_stage_) {
    std::fprintf(stderr, "%3d %%  %s\n", percent, text.c_str());
  }
  last_stage_ = text;
  return !stop_asked;
}

} // namespace bregma::cli
