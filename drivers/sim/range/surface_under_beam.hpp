// What a range sensor that looks straight down meets: the uppermost surface of a mesh on a table.
//
// Frame of the mesh: z up, the table at z = 0, mm. Beside the mesh the beam meets the table. The spot of the beam has a
// radius: where part of it lies on a surface more than `kEdge_mm` higher or lower than the plane through its middle,
// the target has that second distance.
//
// Const after construction; any thread; queries do not allocate.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "algorithms/surface/triangle_mesh.hpp"
#include "drivers/sim/range/sharp_sensor.hpp"

namespace bregma::sim {

class SurfaceUnderBeam {
public:
  static constexpr double kEdge_mm = 5.0;
  static constexpr double kSpotRadius_mm = 2.0;

  // Throws std::invalid_argument for a mesh without triangles.
  explicit SurfaceUnderBeam(const surface::TriangleMesh &mesh);

  struct Top {
    double z_mm = 0.0;
    Eigen::Vector3d normal = Eigen::Vector3d::UnitZ(); // unit, upwards
  };
  // The uppermost point of the mesh; nullopt: there is only the table.
  [[nodiscard]] std::optional<Top> top(double x_mm, double y_mm) const;
  // What the beam of a sensor at this height above the table meets.
  [[nodiscard]] BeamTarget target(double x_mm, double y_mm, double height_mm) const;

  // The mesh's box.
  [[nodiscard]] const Eigen::Vector3d &low_mm() const { return low_; }
  [[nodiscard]] const Eigen::Vector3d &high_mm() const { return high_; }

private:
  [[nodiscard]] std::size_t cell_of(double x_mm, double y_mm) const;

  surface::TriangleMesh mesh_;
  Eigen::Vector3d low_, high_;
  std::size_t columns_ = 0, rows_ = 0;
  std::vector<std::uint32_t> first_; // of each cell in triangles_, and the end
  std::vector<std::uint32_t> triangles_;
};

} // namespace bregma::sim
