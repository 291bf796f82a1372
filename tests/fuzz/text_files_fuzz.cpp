// Any bytes as a list of points, curves or an ITK transform: nothing crashes, and what is taken is finite.
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include <unistd.h>

#include "casefile/itk_transform.hpp"
#include "casefile/markups.hpp"
#include "clients/cli/registration/point_file.hpp"

namespace {

using namespace bregma;

void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

// The readers take files. One of each name, written anew for every input; gone at the end.
class Scratch {
public:
  Scratch() {
    std::string pattern = (std::filesystem::temp_directory_path() / "bregma-fuzz-XXXXXX").string();
    require(mkdtemp(pattern.data()) != nullptr);
    folder_ = pattern;
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  Scratch(const Scratch &) = delete;
  Scratch &operator=(const Scratch &) = delete;
  std::filesystem::path write(const char *name, const char *data, std::size_t size) const {
    std::ofstream(folder_ / name, std::ios::binary).write(data, static_cast<std::streamsize>(size));
    return folder_ / name;
  }

private:
  std::filesystem::path folder_;
};

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
  static const Scratch scratch;
  if (size == 0) {
    return 0;
  }
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const char *content = reinterpret_cast<const char *>(data) + 1;
  const std::size_t length = size - 1;
  switch (data[0] % 4) { // the seeds begin with the digits 0 to 3
  case 0: {
    const auto file = scratch.write("a.csv", content, length);
    read_points(file);
    read_curves(file);
    break;
  }
  case 1: {
    const auto file = scratch.write("a.mrk.json", content, length);
    read_points(file);
    read_curves(file);
    break;
  }
  case 2:
    read_points(scratch.write("a.fcsv", content, length));
    break;
  default: {
    const auto file = scratch.write("a.tfm", content, length);
    const auto affine = casefile::read_itk_transform(file);
    const auto rigid = casefile::read_itk_rigid(file);
    require(!affine || affine->allFinite());
    require(!rigid || rigid->matrix().allFinite());
    break;
  }
  }
  return 0;
}
