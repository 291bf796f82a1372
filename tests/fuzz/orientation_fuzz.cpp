// Orientation of a plane as a scanner prints it: every accepted text gives a unit normal, whose printed form is
// accepted.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "algorithms/mri/frames.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  using namespace bregma::mri;
  const auto normal = parse_orientation({reinterpret_cast<const char *>(data), size});
  if (normal) {
    const auto again = parse_orientation(print_orientation(*normal));
    if (!(std::abs(normal->norm() - 1.0) < 1e-9) || !again || !(std::abs(again->dot(*normal)) > std::cos(0.002))) {
      std::abort();
    }
  }
  return 0;
}
