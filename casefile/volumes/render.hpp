// Pictures of a case without a display or a GPU: a small z-buffer rasteriser with Lambert shading.
// Deterministic; safe from any thread. Not for a loop.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/surface/triangle_mesh.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

using Colour = std::array<std::uint8_t, 3>; // red, green, blue

// Orthographic. `towards_eye` points from the scene to the viewer, `up` is up in the picture (need not be normal to
// it). In RAS (1, 0, 0) looks at the patient's right side, (0, 1, 0) at the face, (0, 0, 1) at the top of the head.
struct Camera {
  Eigen::Vector3d towards_eye = Eigen::Vector3d::UnitY();
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  double margin = 0.05; // fraction of the picture left free around the meshes
};

struct SceneMesh {
  const surface::TriangleMesh *mesh = nullptr; // must outlive render()
  std::vector<Colour> vertex_colours;          // one per vertex, or one for all
  double opacity = 1.0;                        // below 1: its nearest layer is blended over the background
  // If set, only the side with normal . (x - point) <= 0 is drawn, so that the interior is visible.
  bool cut = false;
  Eigen::Vector3d cut_point_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d cut_normal = Eigen::Vector3d::UnitX();
};

struct SceneSphere {
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  double radius_mm = 2.5;
  Colour colour{255, 255, 255};
};

struct SceneLine {
  Eigen::Vector3d from_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d to_mm = Eigen::Vector3d::Zero();
  double radius_mm = 1.0;
  Colour colour{255, 255, 255};
};

struct Scene {
  Camera camera;
  std::vector<SceneMesh> meshes;
  std::vector<SceneSphere> spheres;
  std::vector<SceneLine> lines;
  Colour background{255, 255, 255};
  int width = 800; // pixels
  int height = 800;
};

struct Image {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb; // 3 bytes per pixel, row by row from the top
};

// Each pixel is the mean of 2x2 samples. The picture shows the meshes completely and true to scale.
[[nodiscard]] Image render(const Scene &scene);

[[nodiscard]] base::Result<std::vector<std::uint8_t>> encode_png(const Image &image);

} // namespace bregma::casefile
