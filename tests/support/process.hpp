// A child process of a test. The destructor ends it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

namespace bregma::test {

class Process {
public:
  // Standard output and error go to the log file. Throws std::system_error if the process cannot be started.
  Process(const std::vector<std::string> &command, std::string log_file);
  ~Process(); // SIGKILL if it still runs
  Process(const Process &) = delete;
  Process &operator=(const Process &) = delete;

  void signal(int number) const;
  // The exit status (128 + signal if a signal ended it), or empty if the process still runs after the timeout.
  [[nodiscard]] std::optional<int> wait(double seconds);
  [[nodiscard]] bool runs() { return !wait(0.0).has_value(); }
  [[nodiscard]] pid_t pid() const { return pid_; }
  [[nodiscard]] std::string log() const;

private:
  pid_t pid_ = -1;
  std::optional<int> status_;
  std::string log_file_;
};

} // namespace bregma::test
