// Arbitrary bytes as a distortion field: nothing crashes, and what is accepted has as many vectors as its grid has
// nodes.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "casefile/volumes/displacement_file.hpp"
#include "tests/support/temporary_folder.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  using namespace bregma;
  static const test::TemporaryFolder scratch;
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data), size);
  const std::size_t half = content.find("NRRD", 4); // two files in one input: displacements, errors
  const auto file = scratch.write("f.nrrd", content.substr(0, half));
  scratch.write("f.error.nrrd", half == std::string_view::npos ? std::string_view() : content.substr(half));
  const auto field = casefile::read_displacement_field(file);
  if (field ? field->displacement_mm.voxels.size() != field->displacement_mm.pixels() ||
                  field->signed_error_95_mm.voxels.size() != field->signed_error_95_mm.pixels()
            : field.error().message.empty()) {
    std::abort();
  }
  return 0;
}
