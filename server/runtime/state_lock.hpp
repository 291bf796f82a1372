// One daemon per state directory: a file lock that the kernel releases when the process ends, however it ends.
//
// A second process that asks for the lock is refused, and leaves its number in the file, so that the owner learns of
// it. Threads: one at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>

#include "base/result.hpp"

namespace bregma::runtime {

class StateLock {
public:
  // Takes <folder>/bregmad.lock; creates the folder if it does not exist. The error names the process that has it.
  // A file that cannot be opened or locked for another reason is an error too.
  [[nodiscard]] static base::Result<StateLock> take(const std::filesystem::path &folder);

  StateLock(StateLock &&other) noexcept
      : fd_(std::exchange(other.fd_, -1)), folder_(std::move(other.folder_)), seen_bytes_(other.seen_bytes_) {}
  StateLock &operator=(StateLock &&) = delete;
  StateLock(const StateLock &) = delete;
  StateLock &operator=(const StateLock &) = delete;
  ~StateLock();

  // "process 4711" if another process was refused since the last call.
  [[nodiscard]] std::optional<std::string> refused_process();
  [[nodiscard]] const std::filesystem::path &folder() const { return folder_; }

private:
  StateLock(int fd, std::filesystem::path folder) : fd_(fd), folder_(std::move(folder)) {}

  int fd_;
  std::filesystem::path folder_;
  std::int64_t seen_bytes_ = 0; // of the file
};

} // namespace bregma::runtime
