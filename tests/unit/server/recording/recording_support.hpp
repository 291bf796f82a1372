// Scratch folders and samples for the tests of the session file and the recorder.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <thread>
#include <unistd.h>

#include "idl/names.hpp"

namespace bregma::test {

// A new empty folder that goes with its owner.
class ScratchFolder {
public:
  ScratchFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "bregma-XXXXXX").string();
    path_ = mkdtemp(pattern.data());
  }
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder &) = delete;
  ScratchFolder &operator=(const ScratchFolder &) = delete;
  [[nodiscard]] std::filesystem::path operator/(const std::string &name) const { return path_ / name; }
  [[nodiscard]] const std::filesystem::path &path() const { return path_; }

private:
  std::filesystem::path path_;
};

inline wire::NavigationState navigation(std::uint64_t frame) {
  wire::NavigationState out{};
  static_cast<void>(wire::set_name(out.tool, "Probe"));
  out.frame = frame;
  out.T_image_tip.translation_mm[2] = 0.5 * static_cast<double>(frame);
  return out;
}

inline wire::RangeSample range(std::uint64_t frame) {
  wire::RangeSample out{};
  static_cast<void>(wire::set_name(out.device, "Range"));
  out.frame = frame;
  out.range_mm = 0.25 * static_cast<double>(frame);
  return out;
}

// False when it has not become true after a minute.
inline bool eventually(const std::function<bool()> &condition) {
  for (int i = 0; i < 60'000 && !condition(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return condition();
}

} // namespace bregma::test
