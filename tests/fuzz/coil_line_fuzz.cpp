// Arbitrary bytes from and to a coil controller, split into lines and read: nothing crashes, readings keep the
// guarantees of the protocol, and what is read can be written and read again.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "drivers/coils/coil_line.hpp"
#include "drivers/frame/line_splitter.hpp"

namespace {

void check(std::string_view line) {
  using namespace bregma::coils;
  if (const auto state = parse_state(line)) {
    const std::string again = line_of(*state);
    const auto read = parse_state(std::string_view(again).substr(0, again.size() - 2));
    if (state->lowest_uA > state->highest_uA || (state->faults & ~state->coils) != 0 || state->left_ms < 0 || !read ||
        line_of(*read) != again) {
      std::abort();
    }
  }
  if (const auto order = parse_order(line)) {
    const std::string again = line_of(*order);
    const auto read = parse_order(std::string_view(again).substr(0, again.size() - 2));
    if (!read || read->coils != order->coils || read->current_uA != order->current_uA ||
        read->hold_ms != order->hold_ms) {
      std::abort();
    }
  }
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char *>(data), size);
  bregma::driver::LineSplitter lines(bregma::coils::kMaxLine);
  lines.take(bytes, check);
  check(bytes);
  return 0;
}
