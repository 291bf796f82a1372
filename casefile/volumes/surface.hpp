// Closed surfaces from images, by ITK (segmentation) and VTK (mesh).
//
// Stages: threshold, largest component, morphological closing, holes filled, isosurface (flying edges) of the slightly
// blurred mask, windowed-sinc smoothing, quadric decimation that keeps the surface closed. The outside of the image
// counts as empty: where the object is cut off by the image (the neck), the surface is closed along it. The result is
// one closed 2-manifold, oriented outwards, in Image (RAS, mm); anything else is an Error. Blocking, for seconds; safe
// from any thread.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/surface/triangle_mesh.hpp"
#include "base/result.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

// Called from the calling thread with the completed fraction of the work (0 to 1) and the stage's name. Returning false
// stops the work, and the function returns an Error.
using Progress = std::function<bool(double, std::string_view)>;

struct SurfaceOptions {
  std::optional<double> threshold =
      std::nullopt;              // intensity above which a voxel belongs to the object; default: Otsu's
  double closing_mm = 0.0;       // radius of the ball that closes clefts (sinuses, ear canals, sulci)
  bool fill_holes = true;        // enclosed voids belong to the object
  bool fill_slices = false;      // also voids enclosed within an axial slice: airways that end in the neck's cut
  double blur_mm = 1.0;          // sigma of the Gaussian on the mask, which removes the voxels' steps
  int smoothing_iterations = 20; // windowed sinc; 0: none
  double pass_band = 0.1;        // pass band of the windowed sinc: lower is smoother
  int vertices = 10'000;         // maximum; the mesh is decimated to it, as far as its topology allows
};

// The skin of a head in an image, closed over nostrils, ear canals and the neck's cut.
[[nodiscard]] SurfaceOptions scalp_options();

struct SurfaceReport {
  double threshold = 0.0;        // the threshold that was used
  int full_vertices = 0;         // before decimation
  double mean_distance_mm = 0.0; // from the full surface's vertices to the decimated surface
  double max_distance_mm = 0.0;
  double volume_ml = 0.0;
};

struct ExtractedSurface {
  surface::TriangleMesh mesh;
  SurfaceReport report;
};

[[nodiscard]] base::Result<ExtractedSurface> extract_surface(const Volume &volume, const SurfaceOptions &options,
                                                             const Progress &progress = {});

// The surface around all voxels with any of `labels`, with all its parts.
[[nodiscard]] base::Result<ExtractedSurface> extract_surface(const LabelVolume &volume,
                                                             std::span<const std::int16_t> labels,
                                                             const SurfaceOptions &options,
                                                             const Progress &progress = {});

struct MeshCheck {
  bool closed = false;   // every edge has two triangles
  bool manifold = false; // and every vertex one fan of triangles, no triangle is degenerate
  bool oriented = false; // neighbours agree on the side, and the enclosed volume is positive
  int components = 0;
  double volume_ml = 0.0;
  double area_cm2 = 0.0;
};
[[nodiscard]] MeshCheck check_mesh(const surface::TriangleMesh &mesh);

// For each point the nearest one on the surface, not only among its vertices. Each call builds a search tree: query
// many points at once.
[[nodiscard]] std::vector<Eigen::Vector3d> nearest_on_surface(const surface::TriangleMesh &mesh,
                                                              std::span<const Eigen::Vector3d> points_mm);

} // namespace bregma::casefile
