#include "clients/cli/registration/image_warp.hpp"

#include <algorithm>
#include <cmath>
#include <thread>

#include <Eigen/Geometry>

#include "algorithms/intensity/similarity.hpp"
#include "algorithms/intensity/warp.hpp"
#include "algorithms/parallel/team.hpp"
#include "algorithms/registration/splines/spline_grid.hpp"

namespace bregma::cli {

namespace {

using casefile::Volume;
using Eigen::Vector3d;

// Spacing of the grid nodes that approximate the spline.
constexpr double kGridSpacing_mm = 4.0;

Eigen::AlignedBox3d box_of(const Volume &volume) {
  Eigen::AlignedBox3d out;
  for (unsigned corner = 0; corner < 8; ++corner) {
    Vector3d index;
    for (unsigned axis = 0; axis < 3; ++axis) {
      index[axis] = ((corner >> axis) & 1U) != 0 ? volume.size[axis] - 1 : 0;
    }
    out.extend(volume.point_mm(index));
  }
  return out;
}

} // namespace

base::Result<WarpedImage> warp_image(const std::string &source_file, const std::string &target_file,
                                     const registration::ThinPlateSpline<3> &to_source,
                                     std::vector<std::string> &notes) {
  const auto source = casefile::read_volume(source_file, {}, &notes);
  if (!source) {
    return tl::unexpected(source.error());
  }
  const auto target = casefile::read_volume(target_file, {}, &notes);
  if (!target) {
    return tl::unexpected(target.error());
  }
  const auto threads = static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1U, 2U));
  const Eigen::AlignedBox3d box = box_of(*target);
  const registration::SplineGrid<3> map(to_source, box.min(), box.max(), kGridSpacing_mm, threads);
  parallel::Team team(threads);
  const auto unmoved = [](const Vector3d &p) { return p; };
  std::vector<float> before = intensity::warp<3>(*target, *source, source->voxels, unmoved, team);
  std::vector<float> after = intensity::warp<3>(*target, *source, source->voxels, map, team);
  WarpedImage out;
  out.grid_error_mm = map.largest_error_mm();
  out.image.size = target->size;
  out.image.T_image_index = target->T_image_index;
  out.image.voxels = after;
  std::replace_if(
      out.image.voxels.begin(), out.image.voxels.end(), [](float v) { return !std::isfinite(v); }, 0.0F);
  intensity::restrict_to_overlap({&before, &after});
  out.after = {intensity::rmse(target->voxels, after), intensity::mutual_information(target->voxels, after)};
  out.before = {intensity::rmse(target->voxels, before), intensity::mutual_information(target->voxels, before)};
  return out;
}

} // namespace bregma::cli
