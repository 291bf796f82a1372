// Arbitrary bytes as a list of points, curves, a transform or a sequence of poses: nothing crashes, and accepted values
// are finite.
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string_view>

#include "casefile/itk_transform.hpp"
#include "casefile/markups.hpp"
#include "casefile/poses.hpp"
#include "clients/cli/registration/point_file.hpp"
#include "tests/support/temporary_folder.hpp"

namespace {

using namespace bregma;

void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

void read_points(const std::filesystem::path &file) {
  const auto read = cli::read_point_file(file);
  require(read || !read.error().message.empty());
  if (read) {
    require(read->covariances.empty() || read->covariances.size() == read->points.size());
    for (const auto &point : read->points) {
      require(point.position_mm.allFinite());
    }
  }
}

void read_curves(const std::filesystem::path &file) {
  const auto read = casefile::read_curves(file);
  require(read || !read.error().message.empty());
  for (const auto &curve : read ? *read : std::vector<casefile::MarkedCurve>()) {
    require(curve.points_mm.size() >= (curve.closed ? 3U : 2U));
  }
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  // The readers take files: one of each name, written anew for every input.
  static const test::TemporaryFolder scratch;
  if (size == 0) {
    return 0;
  }
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data) + 1, size - 1);
  switch (static_cast<unsigned>(data[0] - '0') % 5) { // the seeds begin with the digits 0 to 4
  case 0: {
    const auto file = scratch.write("a.csv", content);
    read_points(file);
    read_curves(file);
    break;
  }
  case 1: {
    const auto file = scratch.write("a.mrk.json", content);
    read_points(file);
    read_curves(file);
    break;
  }
  case 2:
    read_points(scratch.write("a.fcsv", content));
    break;
  case 3: {
    const auto file = scratch.write("a.tfm", content); // or a .mat: the content decides
    const auto affine = casefile::read_itk_transform(file);
    const auto rigid = casefile::read_itk_rigid(file);
    require(!affine || affine->allFinite());
    require(!rigid || rigid->matrix().allFinite());
    break;
  }
  default: {
    const auto poses = casefile::read_transform_sequence(scratch.write("a.igs.mha", content));
    require(poses || !poses.error().message.empty());
    for (const auto &frame : poses ? poses->frames : std::vector<casefile::SequenceFrame>()) {
      for (const auto &[name, entry] : frame.transforms) {
        require(entry.pose.matrix().allFinite());
      }
    }
    break;
  }
  }
  return 0;
}
