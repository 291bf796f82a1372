// Arbitrary bytes from and to an arm, split into lines and read: nothing crashes, and what is read can be written and
// read again.
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "drivers/arm/arm_line.hpp"
#include "drivers/frame/line_splitter.hpp"

namespace {

template <class Parse> void check_with(std::string_view line, Parse parse) {
  if (const auto message = parse(line)) {
    const std::string again = bregma::arm::line_of(*message);
    const auto read = parse(std::string_view(again).substr(0, again.size() - 2));
    if (again.size() - 2 > bregma::arm::kMaxLine || !read || *read != *message) {
      std::abort();
    }
  }
}

void check(std::string_view line) {
  check_with(line, bregma::arm::parse_from_arm);
  check_with(line, bregma::arm::parse_to_arm);
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char *>(data), size);
  bregma::driver::LineSplitter lines(bregma::arm::kMaxLine);
  lines.take(bytes, check);
  check(bytes);
  return 0;
}
