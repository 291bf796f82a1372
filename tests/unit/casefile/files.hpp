// Files of a test: a folder that goes with the test, and the shared data where it is.
#pragma once

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <stdexcept>
#include <string>

namespace bregma::tests {

class TempFolder {
public:
  TempFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "bregma-test-XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) {
      throw std::runtime_error("no temporary folder");
    }
    path_ = pattern;
  }
  ~TempFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TempFolder(const TempFolder &) = delete;
  TempFolder &operator=(const TempFolder &) = delete;

  [[nodiscard]] const std::filesystem::path &path() const { return path_; }
  std::filesystem::path write(const std::string &name, const std::string &content) const {
    std::filesystem::path file = path_ / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << content;
    return file;
  }

private:
  std::filesystem::path path_;
};

inline std::string read_file(const std::filesystem::path &file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// Real recordings beside the project; nothing on a machine that has none.
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
