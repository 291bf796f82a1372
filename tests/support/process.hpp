// A child process of a test: started, signalled, waited for; never left behind.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

namespace bregma::test {

class Process {
public:
  // Standard output and error go to the log file. Throws std::system_error when it cannot be started.
  Process(const std::vector<std::string> &command, std::string log_file);
  ~Process(); // SIGKILL if it still runs
  Process(const Process &) = delete;
  Process &operator=(const Process &) = delete;

  void signal(int number) const;
  // The exit status (128 + signal when one ended it), or nothing when it still runs after so long.
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
