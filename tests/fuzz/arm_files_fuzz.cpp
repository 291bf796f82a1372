// Descriptions of arms, as tables and as URDF: any text is read or refused, never more.
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "casefile/arm_files/arm_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char *>(data), size);
  (void)bregma::casefile::parse_urdf_arm(text, "fuzz.urdf");
  (void)bregma::casefile::parse_dh_arm(text, "fuzz.toml");
  return 0;
}
