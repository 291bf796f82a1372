#include "algorithms/tissue/mesh/mesh_quality.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <Eigen/Geometry>

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

// Outward normals of the faces opposite the corners, of twice their area; and six times the volume.
struct Faces {
  std::array<Vector3d, 4> normal;
  double six_volumes = 0.0;
};

Faces faces_of(const Vector3d &a, const Vector3d &b, const Vector3d &c, const Vector3d &d) {
  const Vector3d ab = b - a;
  const Vector3d ac = c - a;
  const Vector3d ad = d - a;
  Faces out;
  out.normal[1] = -ac.cross(ad);
  out.normal[2] = -ad.cross(ab);
  out.normal[3] = -ab.cross(ac);
  out.normal[0] = -(out.normal[1] + out.normal[2] + out.normal[3]);
  out.six_volumes = -out.normal[3].dot(ad);
  return out;
}

double length_of(const Faces &faces) {
  double sum = 0.0;
  for (const Vector3d &normal : faces.normal) {
    sum += normal.squaredNorm();
  }
  return sum > 0.0 ? faces.six_volumes / std::sqrt(sum) : 0.0;
}

// r = 3 V / A; R = |AB|^2 ... by Heron's formula on the products of opposite edges (Crelle): 24 V R.
double radius_ratio(const std::array<Vector3d, 4> &p, const Faces &faces) {
  double twice_area = 0.0;
  for (const Vector3d &normal : faces.normal) {
    twice_area += normal.norm();
  }
  const double u = (p[0] - p[1]).norm() * (p[2] - p[3]).norm();
  const double v = (p[0] - p[2]).norm() * (p[1] - p[3]).norm();
  const double w = (p[0] - p[3]).norm() * (p[1] - p[2]).norm();
  const double product = std::sqrt(std::max(0.0, (u + v + w) * (u + v - w) * (u - v + w) * (-u + v + w)));
  if (twice_area <= 0.0 || product <= 0.0) {
    return 0.0;
  }
  const double inradius = faces.six_volumes / twice_area;
  const double circumradius = product / (4.0 * faces.six_volumes);
  return 3.0 * inradius / circumradius;
}

std::array<Vector3d, 4> corners_of(const TetMesh &mesh, const Eigen::Vector4i &t) {
  std::array<Vector3d, 4> out;
  for (std::size_t i = 0; i < 4; ++i) {
    out[i] = mesh.nodes_mm[static_cast<std::size_t>(t[static_cast<Eigen::Index>(i)])];
  }
  return out;
}

class Survey {
public:
  explicit Survey(const TetMesh &mesh) : mesh_(mesh) {
    const TetBoundary boundary = boundary_of(mesh);
    out_.nodes = static_cast<int>(mesh.nodes_mm.size());
    out_.tetrahedra = static_cast<int>(mesh.tetrahedra.size());
    out_.boundary_nodes = static_cast<int>(boundary.nodes.size());
    out_.boundary_triangles = static_cast<int>(boundary.triangles.size());
    out_.volume_mm3 = volume_mm3(mesh);
    out_.min_dihedral_deg = 180.0;
    out_.min_edge_mm = out_.min_altitude_mm = out_.stable_length_mm = std::numeric_limits<double>::infinity();
  }

  MeshQuality run() {
    std::vector<double> ratios = radius_ratios(mesh_);
    for (const Eigen::Vector4i &t : mesh_.tetrahedra) {
      const std::array<Vector3d, 4> p = corners_of(mesh_, t);
      const Faces faces = faces_of(p[0], p[1], p[2], p[3]);
      out_.stable_length_mm = std::min(out_.stable_length_mm, length_of(faces));
      for (std::size_t i = 0; i < 4; ++i) {
        out_.min_altitude_mm = std::min(out_.min_altitude_mm, faces.six_volumes / faces.normal[i].norm());
        for (std::size_t j = i + 1; j < 4; ++j) {
          add_edge((p[i] - p[j]).norm());
          add_dihedral(faces.normal[i], faces.normal[j]);
        }
      }
    }
    std::sort(ratios.begin(), ratios.end());
    out_.min_radius_ratio = ratios.front();
    out_.percentile5_radius_ratio = ratios[(ratios.size() - 1) / 20];
    for (const double ratio : ratios) {
      out_.mean_radius_ratio += ratio / static_cast<double>(ratios.size());
    }
    return out_;
  }

private:
  void add_edge(double length_mm) {
    out_.min_edge_mm = std::min(out_.min_edge_mm, length_mm);
    out_.max_edge_mm = std::max(out_.max_edge_mm, length_mm);
  }

  void add_dihedral(const Vector3d &one, const Vector3d &other) {
    const double outer = std::atan2(one.cross(other).norm(), one.dot(other));
    const double angle = 180.0 - outer * 180.0 / std::numbers::pi;
    out_.min_dihedral_deg = std::min(out_.min_dihedral_deg, angle);
    out_.max_dihedral_deg = std::max(out_.max_dihedral_deg, angle);
    const int bin = std::clamp(static_cast<int>(angle / MeshQuality::kBin_deg), 0, MeshQuality::kBins - 1);
    ++out_.dihedral_histogram[static_cast<std::size_t>(bin)];
  }

  const TetMesh &mesh_;
  MeshQuality out_;
};

} // namespace

double stable_length_mm(const Vector3d &a, const Vector3d &b, const Vector3d &c, const Vector3d &d) {
  return length_of(faces_of(a, b, c, d));
}

double stable_length_mm(const TetMesh &mesh) {
  double least = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector4i &t : mesh.tetrahedra) {
    const auto node = [&](int i) -> const Vector3d & { return mesh.nodes_mm[static_cast<std::size_t>(t[i])]; };
    least = std::min(least, stable_length_mm(node(0), node(1), node(2), node(3)));
  }
  return least;
}

double stable_step_s(double stable_length_mm, const Material &material) {
  check(material);
  const double wave_speed_m_s = std::sqrt(material.wave_modulus_Pa() / material.density_kg_m3);
  return 1e-3 * stable_length_mm / wave_speed_m_s;
}

std::vector<double> radius_ratios(const TetMesh &mesh) {
  std::vector<double> ratios;
  ratios.reserve(mesh.tetrahedra.size());
  for (const Eigen::Vector4i &t : mesh.tetrahedra) {
    const std::array<Vector3d, 4> p = corners_of(mesh, t);
    ratios.push_back(radius_ratio(p, faces_of(p[0], p[1], p[2], p[3])));
  }
  return ratios;
}

MeshQuality quality_of(const TetMesh &mesh) {
  check(mesh);
  return Survey(mesh).run();
}

} // namespace bregma::tissue
