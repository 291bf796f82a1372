// A folder that is gone with its test.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace bregma::test {

class TemporaryFolder {
public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "bregma-test-XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder &) = delete;
  TemporaryFolder &operator=(const TemporaryFolder &) = delete;
  [[nodiscard]] std::filesystem::path operator/(const char *name) const { return path_ / name; }

private:
  std::filesystem::path path_;
};

} // namespace bregma::test
