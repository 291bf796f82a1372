// Arbitrary bytes as an image file: nothing crashes, and an accepted header has voxels and an affine grid. That a file
// which was cut is refused, at any place, is a test: FaultInput.AnImageThatIsNotWholeIsRefused.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "casefile/volumes/dicom_file.hpp"
#include "casefile/volumes/image_header.hpp"
#include "tests/support/temporary_folder.hpp"

namespace {

using namespace bregma;

void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

base::Result<casefile::ImageHeader> read(char kind, const std::filesystem::path &file) {
  return kind == 0   ? casefile::read_nrrd_header(file, std::nullopt)
         : kind == 1 ? casefile::read_meta_header(file, std::nullopt)
                     : casefile::read_nifti_header(file);
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  static const test::TemporaryFolder scratch;
  if (size == 0) {
    return 0;
  }
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data) + 1, size - 1);
  const auto kind = static_cast<char>(static_cast<unsigned>(data[0] - '0') % 4); // the seeds begin with a digit
  const auto file = scratch.write("a.image", content);
  if (kind == 3) {
    const auto dicom = casefile::read_dicom_file(file);
    require(dicom || !dicom.error().message.empty());
    return 0;
  }
  const auto header = read(kind, file);
  require(header || !header.error().message.empty());
  if (!header) {
    return 0;
  }
  const std::int64_t voxels = header->size[0] * header->size[1] * header->size[2];
  require(voxels > 0 && header->T_ras_index.row(3) == Eigen::RowVector4d(0, 0, 0, 1));
  return 0;
}
