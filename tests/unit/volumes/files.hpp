// Folders of these tests.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>

#include "tests/support/temporary_folder.hpp"

namespace bregma::test {

inline std::filesystem::path shared_data() { return std::filesystem::path(BREGMA_SOURCE_DIR) / "../shared/data"; }
inline std::filesystem::path templates() { return "/usr/share/mricron/templates"; }

inline void write_bytes(const std::filesystem::path &file, const std::string &bytes) {
  std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

inline std::string read_bytes(const std::filesystem::path &file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

} // namespace bregma::test
