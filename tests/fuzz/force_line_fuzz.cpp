// Arbitrary bytes from the force sensor of examples/new_driver, split into lines and read: nothing crashes, and
// readings satisfy the guarantees of the protocol.
#include <cmath>
#include <cstdint>
#include <cstdlib>

#include "drivers/frame/line_splitter.hpp"
#include "examples/new_driver/force_line.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  std::string_view bytes(reinterpret_cast<const char *>(data), size);
  bregma::driver::LineSplitter lines(force_line::kMaxLength);
  const auto read = [](std::string_view line) {
    if (line.size() > force_line::kMaxLength) {
      std::abort();
    }
    const auto reading = force_line::parse(line);
    if (reading) {
      for (const double force : reading->force_N) {
        if (!std::isfinite(force) || reading->time_us < 0) {
          std::abort();
        }
      }
    }
  };
  // In pieces, like received data: the first byte of each piece is its length.
  while (!bytes.empty()) {
    const auto length = std::min<std::size_t>(static_cast<unsigned char>(bytes.front()), bytes.size() - 1);
    lines.take(bytes.substr(1, length), read);
    bytes.remove_prefix(1 + length);
  }
  (void)force_line::parse(std::string_view(reinterpret_cast<const char *>(data), size));
  return 0;
}
