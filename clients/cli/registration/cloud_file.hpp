// What a registration of clouds or surfaces takes: points from a list or from a surface's vertices; a surface from a
// mesh file or from an image of a head.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/surface/triangle_mesh.hpp"
#include "base/result.hpp"
#include "clients/cli/registration/registration_files.hpp"

namespace bregma::cli {

struct Cloud {
  std::vector<Eigen::Vector3d> points_mm;
  std::string remark; // what was assumed, for the person; may be empty
};
[[nodiscard]] base::Result<Cloud> read_cloud(const InputFile &file, const casefile::SizeLimits &size);

struct Surface {
  surface::TriangleMesh mesh; // RAS, mm; outward where it is closed
  std::string remark;
};
// An image (NIfTI, NRRD, MetaImage, a folder of DICOM) has its scalp extracted, with progress on standard error:
// seconds.
[[nodiscard]] base::Result<Surface> read_surface_or_image(const InputFile &file);

} // namespace bregma::cli
