// The picture of a brain shift: sections of the brain as imaged (outline) and after the shift (coloured by
// displacement).
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::bench {

struct ShiftSection {
  std::string title;
  int normal = 0;         // axis normal to the section
  double offset_mm = 0.0; // position on that axis
};

struct ShiftPicture {
  const tissue::TetMesh *mesh = nullptr;
  const std::vector<Eigen::Vector3d> *displacement_mm = nullptr; // by node
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();
  Eigen::Vector3d craniotomy_mm = Eigen::Vector3d::Zero();
  double craniotomy_radius_mm = 0.0;
  double fluid_height_mm = 0.0; // against gravity, from the origin
  std::vector<ShiftSection> sections;
};

// Throws std::runtime_error when the file cannot be written.
void draw(const ShiftPicture &picture, const std::string &file);

} // namespace bregma::bench
