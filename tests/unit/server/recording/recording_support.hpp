// TemporaryFolder folders and samples for the tests of the session file and the recorder.
#pragma once

#include <chrono>
#include <functional>
#include <thread>

#include "idl/names.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::test {

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

// False if the condition is not true within one minute.
inline bool eventually(const std::function<bool()> &condition) {
  for (int i = 0; i < 60'000 && !condition(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return condition();
}

} // namespace bregma::test
