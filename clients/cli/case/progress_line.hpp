// Progress of long work on standard error: one line that is rewritten on a terminal, elsewhere one line per stage.
#pragma once

#include <string>
#include <string_view>

namespace bregma::cli {

class ProgressLine {
public:
  ProgressLine(); // from now on SIGINT and SIGTERM request the work to stop instead of ending the process
  ~ProgressLine();
  ProgressLine(const ProgressLine &) = delete;
  ProgressLine &operator=(const ProgressLine &) = delete;

  // False after Ctrl-C.
  [[nodiscard]] bool show(double done, std::string_view stage);

private:
  bool terminal_ = false;
  std::string last_stage_;
};

} // namespace bregma::cli
