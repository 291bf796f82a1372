// A small complete case: a head of 90 mm radius with a plan and three tools. For tests that change one part of it.
#pragma once

#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "casefile/case.hpp"

namespace bregma::tests {

// A sphere by subdivision of an octahedron; closed, with outward normals.
inline surface::TriangleMesh sphere(const Eigen::Vector3d &centre, double radius, int divisions = 3) {
  surface::TriangleMesh mesh;
  mesh.vertices_mm = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  mesh.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int division = 0; division < divisions; ++division) {
    std::map<std::pair<int, int>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [it, fresh] = middles.try_emplace(std::minmax(a, b), static_cast<int>(mesh.vertices_mm.size()));
      if (fresh) {
        const auto at = [&](int i) { return mesh.vertices_mm[static_cast<std::size_t>(i)]; };
        mesh.vertices_mm.push_back((at(a) + at(b)).normalized());
      }
      return it->second;
    };
    std::vector<Eigen::Vector3i> finer;
    for (const Eigen::Vector3i &t : mesh.triangles) {
      const int ab = middle(t[0], t[1]);
      const int bc = middle(t[1], t[2]);
      const int ca = middle(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], ab, ca}, {t[1], bc, ab}, {t[2], ca, bc}, {ab, bc, ca}});
    }
    mesh.triangles = std::move(finer);
  }
  for (Eigen::Vector3d &v : mesh.vertices_mm) {
    v = centre + radius * v;
  }
  return mesh;
}

// The image must exist when the case is loaded again; its content is not read.
inline casefile::Case sample_case(const std::filesystem::path &folder) {
  using casefile::ToolRole;
  casefile::Case c;
  c.folder = folder;
  c.id = "sample";
  c.image = folder / "image.nii.gz";
  c.scalp = {"scalp", sphere({0, 0, 0}, 90)};
  c.brain = {"brain", sphere({0, 0, 5}, 70)};
  c.structures = {{"Precentral L", sphere({-40, 0, 30}, 10, 2)}, {"Precentral R", sphere({40, 0, 30}, 10, 2)}};
  c.fiducials = {{"F1", {90, 0, 0}}, {"F2", {-90, 0, 0}}, {"F3", {0, 90, 0}}, {"F4", {0, 0, 90}}};
  c.landmarks = {{"Nasion", {0, 85, -25}}};
  c.brain_landmarks = {{"Anterior commissure", {0, 2, -4}}};
  c.targets = {{"Lesion", {10, -5, 20}}};
  c.trajectories = {{"Biopsy", {0, 40, 80}, {10, -5, 20}}};
  const std::vector<Eigen::Vector3d> markers{{0, 0, 0}, {0, 50, 0}, {60, -25, 0}, {-40, -10, 5}};
  const auto tool = [&](const char *name, ToolRole role, const Eigen::Vector3d &tip_mm) {
    return casefile::ToolModel{.name = name, .role = role, .markers_mm = markers, .nominal_tip_mm = tip_mm};
  };
  c.tools = {tool("Reference", ToolRole::kReference, {0, 0, 0}), tool("Stylus", ToolRole::kPointer, {-150, 0, 0}),
             tool("Probe", ToolRole::kProbe, {-200, 0, -20})};
  c.limits.max_check_mm = 2.5;
  return c;
}

} // namespace bregma::tests
