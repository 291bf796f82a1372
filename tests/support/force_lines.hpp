// Lines of the force sensor of examples/new_driver, independent of its parser.
#pragma once

#include <cstdio>
#include <string>

namespace bregma::test {

// Without the line end.
inline std::string force_line_of(const std::string &content) {
  unsigned sum = 0;
  for (const char c : content) {
    sum ^= static_cast<unsigned char>(c);
  }
  char digits[8];
  (void)std::snprintf(digits, sizeof digits, "*%02X", sum);
  return "$" + content + digits;
}

} // namespace bregma::test
