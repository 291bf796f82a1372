// Standard output at the end of a program: what was lost, as on a full disk, is no success.
#pragma once

#include <string_view>

namespace bregma::base {

// Writes what is still buffered. False if standard output did not take everything, then or before.
[[nodiscard]] bool flush_output();

// A program's last call: exit_code if everything was written, else a sentence on standard error and 2.
[[nodiscard]] int end_output(std::string_view program, int exit_code);

} // namespace bregma::base
