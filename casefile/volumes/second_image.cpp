#include "casefile/volumes/second_image.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <system_error>

#include <Eigen/LU>

#include "base/text.hpp"
#include "casefile/sha256.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

std::string plain_stem(const std::string &name) {
  std::string out;
  for (const char c : name) {
    out += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  }
  return out;
}

base::Result<void> same_images(const Case &c, const fs::path &source, const Volume &volume,
                               const ImageRegistration &registration) {
  if (const auto why = difference(registration.source, identity_of(volume))) {
    return base::failure(source.string() + ": is not the image that was registered: " + *why);
  }
  const auto planning = read_volume(c.image);
  if (!planning) {
    return tl::unexpected(planning.error());
  }
  if (const auto why = difference(registration.target, identity_of(*planning))) {
    return base::failure(source.string() + ": was not registered to the case's image " + c.image.string() + ": " +
                         *why);
  }
  return {};
}

} // namespace

base::Result<fs::path> store_image(const fs::path &source, const Volume &volume, const fs::path &stem) {
  const std::string name = base::lower(source.filename().string());
  for (const std::string extension : {".nii.gz", ".nii", ".nrrd", ".mha"}) {
    if (!name.ends_with(extension) || !fs::is_regular_file(source) || !states_its_space(source)) {
      continue;
    }
    const fs::path out = stem.string() + extension;
    std::error_code error;
    if (fs::equivalent(source, out, error)) {
      return out;
    }
    fs::copy_file(source, out, fs::copy_options::overwrite_existing, error);
    return error ? base::Result<fs::path>(base::failure(out.string() + ": cannot be written: " + error.message()))
                 : out;
  }
  fs::path out = stem.string() + ".nii.gz";
  return write_volume(out, volume).map([&out] { return out; });
}

double covered_fraction(const surface::TriangleMesh &scalp, const image::Grid<3> &grid, const RegisteredImage &image) {
  const Eigen::Matrix4d T_index_image = (image.T_image_source.pose.matrix() * grid.T_image_index).inverse();
  const auto inside = [&](const Eigen::Vector3d &vertex) {
    const Eigen::Vector4d index = T_index_image * vertex.homogeneous();
    bool in = true;
    for (std::size_t d = 0; d < 3; ++d) {
      const double i = index[static_cast<Eigen::Index>(d)];
      in = in && i >= -0.5 && i <= grid.size[d] - 0.5;
    }
    return in;
  };
  const auto count = std::count_if(scalp.vertices_mm.begin(), scalp.vertices_mm.end(), inside);
  return static_cast<double>(count) / static_cast<double>(std::max<std::size_t>(scalp.vertices_mm.size(), 1));
}

base::Result<void> add_image(Case &c, const fs::path &source, const Volume &volume,
                             const ImageRegistration &registration, const std::string &name,
                             const std::string &accepted) {
  if (auto same = same_images(c, source, volume, registration); !same) {
    return same;
  }
  RegisteredImage image;
  image.name = name;
  image.T_image_source = registration.T_image_source;
  image.measure = registration.measure;
  image.verdict = registration.verdict;
  image.accepted = accepted;
  image.date = registration.date;
  if (const double covered = covered_fraction(c.scalp.mesh, volume, image); covered < kMinCovered) {
    return base::failure(source.string() + ": with this transform the image contains " +
                         std::to_string(std::lround(100.0 * covered)) +
                         " % of the head's surface: is the transform that of these images?");
  }
  Case with_image = c;
  put_image(with_image, image);
  if (auto sound = check_case(with_image); !sound) {
    return sound;
  }
  std::error_code error;
  fs::create_directories(c.folder / "images", error);
  auto stored = store_image(source, volume, c.folder / "images" / plain_stem(name));
  if (!stored) {
    return tl::unexpected(stored.error());
  }
  const auto own = sha256_of_file(*stored);
  const auto planning = sha256_of_file(c.image);
  if (!own || !planning) {
    return tl::unexpected(own ? planning.error() : own.error());
  }
  image.file = *stored;
  image.sha256 = to_hex(*own);
  image.planning_sha256 = to_hex(*planning);
  put_image(c, std::move(image));
  return {};
}

} // namespace bregma::casefile
