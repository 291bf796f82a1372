// Reading of a whole file that others provide: a fault of the file never blocks or fills the memory.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "base/result.hpp"

namespace bregma::base {

// More than any plan or surface of a head: a PLY file of 10 million triangles.
inline constexpr std::size_t kMaxFileBytes = std::size_t{256} << 20;

// Refuses what is not a regular file (a pipe would block, a device never ends) and a file above max_bytes, also one
// that grows while it is read. Every error names the file. A disk that does not answer still blocks.
[[nodiscard]] Result<std::string> read_file(const std::filesystem::path &file, std::size_t max_bytes = kMaxFileBytes);

} // namespace bregma::base
