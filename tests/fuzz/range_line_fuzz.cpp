// Arbitrary bytes from a range sensor, split into lines and read: nothing crashes, and what is read can be written and
// read again.
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "drivers/frame/line_splitter.hpp"
#include "drivers/range/range_line.hpp"

namespace {

void check(std::string_view line) {
  using namespace bregma::range;
  (void)is_identity_question(line);
  if (const auto message = parse(line)) {
    const std::string again = line_of(*message);
    const auto read = parse(std::string_view(again).substr(0, again.size() - 2));
    if (again.size() - 2 > kMaxLine || !read || *read != *message) {
      std::abort();
    }
  }
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char *>(data), size);
  bregma::driver::LineSplitter lines(bregma::range::kMaxLine);
  lines.take(bytes, check);
  check(bytes);
  return 0;
}
