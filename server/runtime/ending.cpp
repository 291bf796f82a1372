#include "server/runtime/ending.hpp"

#include <thread>

#include <spdlog/spdlog.h>
#include <unistd.h>

namespace bregma::runtime {
namespace {

constexpr std::chrono::milliseconds kLogTime{50}; // for the log's thread to write the line

} // namespace

void end_within(std::chrono::milliseconds limit) {
  std::thread([limit] {
    std::this_thread::sleep_for(limit);
    if (const auto log = spdlog::default_logger()) {
      log->error("ended by force: not all threads ended within {} ms, one may wait for a disk", limit.count());
    }
    std::this_thread::sleep_for(kLogTime);
    ::_exit(kEndedByLimit);
  }).detach();
}

} // namespace bregma::runtime
