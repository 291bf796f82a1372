// Files of a test: a temporary folder, and the shared data if it is available.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>

#include "tests/support/temporary_folder.hpp"

namespace bregma::tests {

inline std::string read_file(const std::filesystem::path &file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// Real recordings next to the project; empty if they are not available.
inline std::optional<std::filesystem::path> shared_data(const std::string &relative) {
  const std::filesystem::path path = std::filesystem::path(BREGMA_SOURCE_DIR) / "../shared/data" / relative;
  return std::filesystem::exists(path) ? std::optional(path) : std::nullopt;
}

} // namespace bregma::tests

#define BREGMA_SHARED_DATA(variable, relative)                                                                         \
  const auto variable##_found = bregma::tests::shared_data(relative);                                                  \
  if (!variable##_found) {                                                                                             \
    GTEST_SKIP() << "../shared/data/" << (relative) << " is not here";                                                 \
  }                                                                                                                    \
  const std::filesystem::path &variable = *variable##_found
