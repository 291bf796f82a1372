// Numbers and matrices in text. Private to this library.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "casefile/poses.hpp"

namespace bregma::casefile::detail {

// The numbers of a text separated by blanks; an error when a word is not a finite number.
[[nodiscard]] tl::expected<std::vector<double>, std::string> parse_numbers(std::string_view text);

// A 4x4 matrix, row by row; an error when it is not a rigid transform.
[[nodiscard]] tl::expected<NamedRigid, std::string> rigid_from_rows(const std::vector<double> &numbers);

} // namespace bregma::casefile::detail
