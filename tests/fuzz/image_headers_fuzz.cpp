// Arbitrary bytes as an image file: nothing crashes, an accepted header has voxels and an affine grid, and a file that
// is accepted is refused when it is cut. The tests cut whole files at 200 places as well (FaultInput).
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <string>
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

base::Result<casefile::ImageHeader> read(const std::filesystem::path &file) {
  const auto header = casefile::read_image_header(file, casefile::image_format_of(file), std::nullopt);
  require(header || !header.error().message.empty());
  return header;
}

bool counted_from_the_end(const casefile::ImageHeader &header) {
  return std::any_of(header.notes.begin(), header.notes.end(),
                     [](const std::string &note) { return note.find("counted from its end") != std::string::npos; });
}

// A cut anywhere before the end of the voxels.
void require_refused_when_cut(const casefile::ImageHeader &header, std::string_view content) {
  if (header.least_bytes == 0 || counted_from_the_end(header)) {
    return;
  }
  require(header.least_bytes <= content.size());
  static const test::TemporaryFolder scratch;
  const std::size_t size = std::hash<std::string_view>()(content) % header.least_bytes;
  require(!read(scratch.write("cut.image", content.substr(0, size))));
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  static const test::TemporaryFolder scratch;
  if (size == 0) {
    return 0;
  }
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data) + 1, size - 1);
  const auto file = scratch.write("a.image", content);
  if (data[0] == '3') { // the seeds begin with a digit
    const auto dicom = casefile::read_dicom_file(file);
    require(dicom || !dicom.error().message.empty());
    return 0;
  }
  const auto header = read(file);
  if (!header) {
    return 0;
  }
  const std::int64_t voxels = header->size[0] * header->size[1] * header->size[2];
  require(voxels > 0 && header->T_ras_index.row(3) == Eigen::RowVector4d(0, 0, 0, 1));
  if (header->voxels) {
    const auto read_back = casefile::read_stored_voxels(*header->voxels, static_cast<std::uint64_t>(voxels));
    require(read_back && read_back->size() == static_cast<std::size_t>(voxels));
  }
  require_refused_when_cut(*header, content);
  return 0;
}
