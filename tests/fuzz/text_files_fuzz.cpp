// Arbitrary bytes as a list of points, curves, trajectories, a transform or poses: nothing crashes, accepted values are
// finite, and a transform or a JSON file that is cut is refused.
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <functional>
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
  switch (static_cast<unsigned>(data[0] - '0') % 6) { // the seeds begin with the digits 0 to 5
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
    const auto paths = casefile::read_trajectories(file);
    require(paths || !paths.error().message.empty());
    const std::size_t end = content.find_last_of('}');
    if (casefile::read_points(file) && end != std::string_view::npos) {
      const std::size_t part = std::hash<std::string_view>()(content) % (end + 1);
      require(!casefile::read_points(scratch.write("cut.mrk.json", content.substr(0, part))));
    }
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
    if (affine && !content.empty()) {
      const std::size_t part = std::hash<std::string_view>()(content) % content.size();
      const auto cut = casefile::read_itk_transform(scratch.write("cut.tfm", content.substr(0, part)));
      require(!cut || *cut == *affine); // cut behind the transform
    }
    break;
  }
  case 4: {
    const auto poses = casefile::read_transform_sequence(scratch.write("a.igs.mha", content));
    require(poses || !poses.error().message.empty());
    for (const auto &frame : poses ? poses->frames : std::vector<casefile::SequenceFrame>()) {
      for (const auto &[name, entry] : frame.transforms) {
        require(entry.pose.matrix().allFinite());
      }
    }
    break;
  }
  default: {
    const auto poses = casefile::read_pose_matrices(scratch.write("poses/100.txt", content).parent_path());
    require(poses || !poses.error().message.empty());
    for (const auto &timed : poses ? poses->poses : std::vector<casefile::TimedPose>()) {
      require(timed.pose.matrix().allFinite());
    }
    break;
  }
  }
  return 0;
}
