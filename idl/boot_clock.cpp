#include "idl/boot_clock.hpp"

#include <charconv>
#include <ctime>
#include <fstream>
#include <string>

namespace bregma::wire {

std::int64_t boot_now_ns() noexcept {
  timespec time{};
  clock_gettime(CLOCK_BOOTTIME, &time);
  return static_cast<std::int64_t>(time.tv_sec) * 1'000'000'000 + time.tv_nsec;
}

std::array<std::uint8_t, 16> boot_id() {
  std::ifstream file("/proc/sys/kernel/random/boot_id");
  std::string text; // 8-4-4-4-12 hexadecimal digits
  std::getline(file, text);
  std::erase(text, '-');
  std::array<std::uint8_t, 16> out{};
  for (std::size_t i = 0; i < out.size() && text.size() == 2 * out.size(); ++i) {
    (void)std::from_chars(&text[2 * i], &text[2 * i] + 2, out[i], 16);
  }
  return out;
}

} // namespace bregma::wire
