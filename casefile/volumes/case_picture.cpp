#include "casefile/volumes/case_picture.hpp"

namespace bregma::casefile {
namespace {

constexpr Colour kScalp{224, 184, 154};
constexpr Colour kBrain{205, 196, 200};
constexpr Colour kFiducial{32, 110, 220};
constexpr Colour kLandmark{20, 160, 150};
constexpr Colour kTarget{230, 30, 40};
constexpr Colour kTrajectory{25, 25, 25};

SceneMesh layer(const surface::TriangleMesh &mesh, const Colour &colour, double opacity) {
  SceneMesh out;
  out.mesh = &mesh;
  out.vertex_colours = {colour};
  out.opacity = opacity;
  return out;
}

} // namespace

Colour structure_colour(std::size_t index) {
  // Okabe and Ito's colours, which colour-blind readers can distinguish.
  static constexpr std::array<Colour, 8> kColours{{{213, 94, 0},
                                                   {0, 158, 115},
                                                   {204, 121, 167},
                                                   {230, 159, 0},
                                                   {86, 180, 233},
                                                   {0, 114, 178},
                                                   {240, 228, 66},
                                                   {120, 120, 120}}};
  return kColours[index % kColours.size()];
}

Scene case_scene(const Case &c, const Eigen::Vector3d &towards_eye, int width, int height) {
  Scene scene;
  scene.camera.towards_eye = towards_eye;
  scene.camera.up = towards_eye.normalized().z() > 0.95 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
  scene.width = width;
  scene.height = height;
  for (std::size_t at = 0; at < c.structures.size(); ++at) {
    scene.meshes.push_back(layer(c.structures[at].mesh, structure_colour(at), 1.0));
  }
  // Transparent layers, drawn from the inside out.
  if (!c.brain.mesh.triangles.empty()) {
    scene.meshes.push_back(layer(c.brain.mesh, kBrain, 0.4));
  }
  scene.meshes.push_back(layer(c.scalp.mesh, kScalp, 0.35));
  for (const NamedPoint &point : c.fiducials) {
    scene.spheres.push_back({point.position_mm, 3.5, kFiducial});
  }
  for (const NamedPoint &point : c.landmarks) {
    scene.spheres.push_back({point.position_mm, 2.5, kLandmark});
  }
  for (const NamedPoint &point : c.targets) {
    scene.spheres.push_back({point.position_mm, 4.0, kTarget});
  }
  for (const Trajectory &trajectory : c.trajectories) {
    // View from the side of the instrument's holder.
    const Eigen::Vector3d outside =
        trajectory.entry_mm + 30.0 * (trajectory.entry_mm - trajectory.target_mm).normalized();
    scene.lines.push_back({outside, trajectory.target_mm, 1.2, kTrajectory});
  }
  return scene;
}

} // namespace bregma::casefile
