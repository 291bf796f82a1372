// Splits a stream of bytes into lines, for text protocols. Pure, bounded, and safe for arbitrary bytes.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace bregma::driver {

class LineSplitter {
public:
  // A longer line is skipped to its end.
  explicit LineSplitter(std::size_t max_length) : max_length_(max_length) {}

  // Calls visit(std::string_view line) for each complete line, without its \n or \r\n. Returns the number of lines that
  // were too long.
  template <class Visit> std::size_t take(std::string_view bytes, Visit &&visit) {
    std::size_t too_long = 0;
    while (!bytes.empty()) {
      const std::size_t end = bytes.find('\n');
      const std::string_view piece = bytes.substr(0, end);
      overflowed_ = overflowed_ || line_.size() + piece.size() > max_length_;
      if (!overflowed_) {
        line_ += piece;
      }
      if (end == std::string_view::npos) {
        break;
      }
      bytes.remove_prefix(end + 1);
      if (overflowed_) {
        ++too_long;
      } else {
        visit(std::string_view(line_).substr(0, line_.ends_with('\r') ? line_.size() - 1 : line_.size()));
      }
      reset();
    }
    return too_long;
  }

  // For a new connection: discards an incomplete line.
  void reset() {
    line_.clear();
    overflowed_ = false;
  }

private:
  std::size_t max_length_;
  std::string line_;
  bool overflowed_ = false;
};

} // namespace bregma::driver
