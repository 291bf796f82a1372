// Private to this library: place of a node in a table whose first axis runs fastest.
#pragma once

#include <cstddef>

namespace bregma::sim::scanner::detail {

// columns and rows: of the table; i, j and k are not negative.
[[nodiscard]] constexpr std::size_t flat(int i, int j, int k, int columns, int rows) {
  const auto wide = static_cast<std::size_t>(columns);
  return (static_cast<std::size_t>(k) * static_cast<std::size_t>(rows) + static_cast<std::size_t>(j)) * wide +
         static_cast<std::size_t>(i);
}

} // namespace bregma::sim::scanner::detail
