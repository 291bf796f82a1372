// Outputs of commands on a case.
#pragma once

#include <string>
#include <string_view>

#include "base/result.hpp"

namespace bregma::cli {

// Refuses an output file in a case's folder that would replace a file of the case or a recording.
[[nodiscard]] base::Result<void> check_output_of_case(std::string_view option, const std::string &output,
                                                      const std::string &folder);

} // namespace bregma::cli
