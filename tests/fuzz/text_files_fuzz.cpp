// Arbitrary bytes as a list of points, curves, trajectories, a transform or poses: nothing crashes, accepted values are
// finite, and a file that is cut is refused, or nothing of its values is missing. Tables (.csv, .fcsv) state no size:
// the number of rows that were read is said.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string_view>

#include "base/text.hpp"
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

using test::TemporaryFolder;

// Where content is cut: anywhere before `end`.
std::string_view cut(std::string_view content, std::size_t end) {
  return content.substr(0, std::hash<std::string_view>()(content) % end);
}

void read_markups(const TemporaryFolder &scratch, std::string_view content) {
  const auto file = scratch.write("a.mrk.json", content);
  read_points(file);
  read_curves(file);
  const auto paths = casefile::read_trajectories(file);
  require(paths || !paths.error().message.empty());
  const std::size_t end = content.find_last_of('}');
  if (casefile::read_markups(file) && end != std::string_view::npos) {
    require(!casefile::read_markups(scratch.write("cut.mrk.json", cut(content, end + 1))));
  }
}

void read_transform(const TemporaryFolder &scratch, std::string_view content) {
  const auto file = scratch.write("a.tfm", content); // or a .mat: the content decides
  const auto affine = casefile::read_itk_transform(file);
  const auto rigid = casefile::read_itk_rigid(file);
  require(!affine || affine->allFinite());
  require(!rigid || rigid->matrix().allFinite());
  if (affine && !content.empty()) {
    const auto of_cut = casefile::read_itk_transform(scratch.write("cut.tfm", cut(content, content.size())));
    require(!of_cut || *of_cut == *affine); // cut behind the transform
  }
}

// Of a sequence: MetaImage's last field, or NRRD's empty line.
std::size_t end_of_header(std::string_view content) {
  const bool nrrd = base::trimmed(content.substr(0, content.find('\n'))).starts_with("NRRD");
  for (std::size_t at = 0; at < content.size();) {
    const std::size_t end = std::min(content.find('\n', at), content.size());
    const std::string_view line = base::trimmed(content.substr(at, end - at));
    if (nrrd ? line.empty() : line.starts_with("ElementDataFile")) {
      return std::max<std::size_t>(at, 1);
    }
    at = end + 1;
  }
  return content.size();
}

void read_sequence(const TemporaryFolder &scratch, std::string_view content) {
  const auto poses = casefile::read_transform_sequence(scratch.write("a.igs.mha", content));
  require(poses || !poses.error().message.empty());
  if (!poses) {
    return;
  }
  for (const auto &frame : poses->frames) {
    for (const auto &[name, entry] : frame.transforms) {
      require(entry.pose.matrix().allFinite());
    }
  }
  require(!casefile::read_transform_sequence(scratch.write("cut.igs.mha", cut(content, end_of_header(content)))));
}

void read_matrix(const TemporaryFolder &scratch, std::string_view content) {
  const auto poses = casefile::read_pose_matrices(scratch.write("poses/100.txt", content).parent_path());
  require(poses || !poses.error().message.empty());
  if (!poses || poses->poses.size() != 1) {
    return;
  }
  const Eigen::Matrix4d whole = poses->poses.front().pose.matrix();
  require(whole.allFinite());
  const auto of_cut =
      casefile::read_pose_matrices(scratch.write("cut/100.txt", cut(content, content.size())).parent_path());
  require(!of_cut || of_cut->poses.front().pose.matrix() == whole); // "1.00" of the last row, or blanks
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  // The readers take files: one of each name, written anew for every input.
  static const TemporaryFolder scratch;
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
  case 1:
    read_markups(scratch, content);
    break;
  case 2:
    read_points(scratch.write("a.fcsv", content));
    break;
  case 3:
    read_transform(scratch, content);
    break;
  case 4:
    read_sequence(scratch, content);
    break;
  default:
    read_matrix(scratch, content);
    break;
  }
  return 0;
}
