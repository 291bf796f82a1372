// Arbitrary bytes as what a camera beside the simulated arm sees, with and without a right checksum: nothing crashes,
// and what is read can be written and read again.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "base/checked_line.hpp"
#include "drivers/sim/arm/scene_line.hpp"

namespace {

std::string_view without_end(std::string_view line) { return line.substr(0, line.size() - 2); }

void check(std::string_view line) {
  using namespace bregma::sim;
  const auto scene = parse_scene(line);
  if (!scene) {
    return;
  }
  const auto again = line_of(*scene);
  const auto read = parse_scene(without_end(again));
  if (again.size() > kMaxSceneLine + 2 || !read || read->time_us != scene->time_us ||
      !read->T_base_flange.matrix().isApprox(scene->T_base_flange.matrix()) ||
      !read->T_base_image.matrix().isApprox(scene->T_base_image.matrix())) {
    std::abort();
  }
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char *>(data), size);
  check(bytes);
  check(without_end(bregma::base::checked_line(bytes)));
  return 0;
}
