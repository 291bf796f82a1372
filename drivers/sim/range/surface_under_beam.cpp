#include "drivers/sim/range/surface_under_beam.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include <Eigen/Geometry>

namespace bregma::sim {

namespace {
constexpr double kCell_mm = 3.0;
} // namespace

SurfaceUnderBeam::SurfaceUnderBeam(const surface::TriangleMesh &mesh) : mesh_(mesh) {
  if (mesh.triangles.empty()) {
    throw std::invalid_argument("a surface under the beam needs at least one triangle");
  }
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d &v : mesh.vertices_mm) {
    box.extend(v);
  }
  low_ = box.min();
  high_ = box.max();
  columns_ = static_cast<std::size_t>(box.sizes().x() / kCell_mm) + 1;
  rows_ = static_cast<std::size_t>(box.sizes().y() / kCell_mm) + 1;
  std::vector<std::vector<std::uint32_t>> cells(columns_ * rows_);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    Eigen::AlignedBox3d of_triangle;
    for (const int corner : mesh.triangles[t]) {
      of_triangle.extend(mesh.vertices_mm[static_cast<std::size_t>(corner)]);
    }
    const auto index = [](double at, double from) { return static_cast<std::size_t>((at - from) / kCell_mm); };
    for (std::size_t row = index(of_triangle.min().y(), low_.y()); row <= index(of_triangle.max().y(), low_.y());
         ++row) {
      for (std::size_t column = index(of_triangle.min().x(), low_.x());
           column <= index(of_triangle.max().x(), low_.x()); ++column) {
        cells[row * columns_ + column].push_back(static_cast<std::uint32_t>(t));
      }
    }
  }
  for (const std::vector<std::uint32_t> &cell : cells) {
    first_.push_back(static_cast<std::uint32_t>(triangles_.size()));
    triangles_.insert(triangles_.end(), cell.begin(), cell.end());
  }
  first_.push_back(static_cast<std::uint32_t>(triangles_.size()));
}

std::size_t SurfaceUnderBeam::cell_of(double x_mm, double y_mm) const {
  const auto column = static_cast<std::size_t>((x_mm - low_.x()) / kCell_mm);
  const auto row = static_cast<std::size_t>((y_mm - low_.y()) / kCell_mm);
  return row * columns_ + column;
}

std::optional<SurfaceUnderBeam::Top> SurfaceUnderBeam::top(double x_mm, double y_mm) const {
  if (!(x_mm >= low_.x() && x_mm <= high_.x() && y_mm >= low_.y() && y_mm <= high_.y())) {
    return std::nullopt;
  }
  const std::size_t cell = cell_of(x_mm, y_mm);
  const Eigen::Vector2d p(x_mm, y_mm);
  std::optional<Top> out;
  for (std::uint32_t i = first_[cell]; i < first_[cell + 1]; ++i) {
    const Eigen::Vector3i &t = mesh_.triangles[triangles_[i]];
    const Eigen::Vector3d &a = mesh_.vertices_mm[static_cast<std::size_t>(t[0])];
    const Eigen::Vector3d &b = mesh_.vertices_mm[static_cast<std::size_t>(t[1])];
    const Eigen::Vector3d &c = mesh_.vertices_mm[static_cast<std::size_t>(t[2])];
    const Eigen::Vector2d ab = (b - a).head<2>();
    const Eigen::Vector2d ac = (c - a).head<2>();
    const Eigen::Vector2d ap = p - a.head<2>();
    const double area = ab.x() * ac.y() - ab.y() * ac.x();
    const double v = (ap.x() * ac.y() - ap.y() * ac.x()) / area;
    const double w = (ab.x() * ap.y() - ab.y() * ap.x()) / area;
    constexpr double kEdge = -1e-9;                            // a beam on the edge of two triangles meets both
    if (!(v >= kEdge && w >= kEdge && v + w <= 1.0 - kEdge)) { // NaN: the triangle is upright
      continue;
    }
    const double z = a.z() + v * (b.z() - a.z()) + w * (c.z() - a.z());
    if (!out || z > out->z_mm) {
      Eigen::Vector3d normal = (b - a).cross(c - a).normalized();
      out = Top{z, normal.z() < 0.0 ? Eigen::Vector3d(-normal) : normal};
    }
  }
  return out;
}

BeamTarget SurfaceUnderBeam::target(double x_mm, double y_mm, double height_mm) const {
  const Top middle = top(x_mm, y_mm).value_or(Top{});
  BeamTarget out{height_mm - middle.z_mm, std::acos(std::clamp(middle.normal.z(), 0.0, 1.0)), std::nan(""),
                 std::atan2(middle.normal.y(), middle.normal.x())};
  double largest_mm = kEdge_mm;
  constexpr std::array<std::array<double, 2>, 4> kRim{{{1.0, 0.0}, {-1.0, 0.0}, {0.0, 1.0}, {0.0, -1.0}}};
  for (const auto &[dx, dy] : kRim) {
    const Eigen::Vector2d offset(kSpotRadius_mm * dx, kSpotRadius_mm * dy);
    const double there_mm = top(x_mm + offset.x(), y_mm + offset.y()).value_or(Top{}).z_mm;
    const double on_plane_mm = middle.z_mm - middle.normal.head<2>().dot(offset) / std::max(middle.normal.z(), 0.1);
    if (const double apart_mm = std::abs(there_mm - on_plane_mm); apart_mm > largest_mm) {
      largest_mm = apart_mm;
      out.other_mm = height_mm - there_mm;
    }
  }
  return out;
}

} // namespace bregma::sim
