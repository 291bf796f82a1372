// Where these tests read and write.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

namespace bregma::test {

inline std::filesystem::path shared_data() { return std::filesystem::path(BREGMA_SOURCE_DIR) / "../shared/data"; }
inline std::filesystem::path templates() { return "/usr/share/mricron/templates"; }

// A folder of this test's own, gone after it.
class Scratch {
public:
  Scratch()
      : path_(std::filesystem::temp_directory_path() /
              (std::string("bregma-") + testing::UnitTest::GetInstance()->current_test_info()->name() + "-" +
               std::to_string(::getpid()))) {
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Scratch(const Scratch &) = delete;
  Scratch &operator=(const Scratch &) = delete;
  [[nodiscard]] std::filesystem::path operator/(const std::string &name) const { return path_ / name; }
  [[nodiscard]] const std::filesystem::path &path() const { return path_; }

private:
  std::filesystem::path path_;
};

inline void write_bytes(const std::filesystem::path &file, const std::string &bytes) {
  std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

inline std::string read_bytes(const std::filesystem::path &file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

} // namespace bregma::test
