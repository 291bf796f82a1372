// Output for log lines that never waits for its reader: a pipe that is full, a terminal that was stopped. Lines that do
// not fit are dropped and counted, and the next line that fits is preceded by their number.
// Threads: one at a time.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace bregma::runtime {

class LogOutput {
public:
  // fd: stays open as long as the output.
  explicit LogOutput(int fd);
  ~LogOutput();
  LogOutput(const LogOutput &) = delete;
  LogOutput &operator=(const LogOutput &) = delete;

  // line: with its newline. False if it was dropped.
  bool write(std::string_view line);
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; } // in total
  [[nodiscard]] bool terminal() const { return terminal_; }

private:
  [[nodiscard]] bool send(std::string_view text);
  [[nodiscard]] std::size_t write_some(std::string_view text) const;

  int fd_;
  int own_fd_ = -1; // the same file, opened without waiting
  bool socket_ = false;
  bool terminal_ = false;
  std::string rest_; // of a line that was written in part
  std::uint64_t dropped_ = 0;
  std::uint64_t stated_ = 0; // number of dropped lines that the output states
};

} // namespace bregma::runtime
