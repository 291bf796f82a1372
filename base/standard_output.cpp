#include "base/standard_output.hpp"

#include <cstdio>
#include <iostream>
#include <string>

namespace bregma::base {

bool flush_output() {
  const bool streams = std::cout.flush().good();
  return std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && streams;
}

int end_output(std::string_view program, int exit_code) {
  constexpr int kLost = 2;
  if (flush_output()) {
    return exit_code;
  }
  const std::string text = std::string(program) + ": the output could not be written completely\n";
  std::fputs(text.c_str(), stderr);
  return kLost;
}

} // namespace bregma::base
