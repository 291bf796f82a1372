// Input of a registration of clouds or surfaces: points from a list or from a surface's vertices; a surface from a mesh
// file or from an image of a head.
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
  std::vector<std::string> notes; // what was assumed or left out
};
[[nodiscard]] base::Result<Cloud> read_cloud(const InputFile &file, const casefile::SizeLimits &size);

struct Surface {
  surface::TriangleMesh mesh; // RAS, mm; oriented outwards if closed
  std::vector<std::string> notes;
};
// The scalp of an image (NIfTI, NRRD, MetaImage, a folder of DICOM) is extracted in seconds, with progress on standard
// error.
[[nodiscard]] base::Result<Surface> read_surface_or_image(const InputFile &file);

} // namespace bregma::cli
