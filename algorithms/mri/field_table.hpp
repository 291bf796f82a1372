// A distortion field on a regular grid: what is saved, and what images are corrected with.
//
// At a true position p the image shows p + displacement(p), linearly interpolated between nodes. On a grid of 4 mm the
// interpolation of distortions as large as those of a clinical scanner differs by some hundredths of a millimetre from
// the field (table_error_mm states it). The stated error is kept on a grid three times as coarse.
//
// Units: mm; the frame is that of the field. const members are thread-safe and do not allocate.
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "algorithms/image/grid.hpp"
#include "algorithms/mri/distortion_field.hpp"

namespace bregma::mri {

class FieldTable {
public:
  using Vector = Eigen::Vector3d;

  struct Sample {
    Coverage coverage = Coverage::kUnknown;
    Vector displacement_mm = Vector::Zero();
    double error_95_mm = 0.0; // of the field, the table's own error included
  };

  // Over the box around the control points, margin_mm wider. threads - 1 are started.
  FieldTable(const DistortionField &field, double spacing_mm = 4.0, double margin_mm = 24.0, int threads = 1);

  // From a file: displacements at the nodes of a grid; errors at those of another, negative where the field
  // extrapolates. Sizes must match the grids.
  FieldTable(image::Image<Eigen::Vector3f, 3> displacement_mm, image::Image<float, 3> signed_error_95_mm,
             double max_error_95_mm);

  [[nodiscard]] const image::Image<Eigen::Vector3f, 3> &displacements() const { return displacement_; }
  [[nodiscard]] const image::Image<float, 3> &signed_errors() const { return error_; }
  [[nodiscard]] double max_error_95_mm() const { return max_error_95_mm_; } // above it: unknown
  // Largest difference from the field at 1,000 points; 0 for a table from a file.
  [[nodiscard]] double table_error_mm() const { return table_error_mm_; }

  // Outside the grid the field is unknown, and the displacement is that of the nearest point in it.
  [[nodiscard]] Vector displacement(const Vector &true_mm) const noexcept;
  [[nodiscard]] Sample sample(const Vector &true_mm) const noexcept;
  [[nodiscard]] Vector to_imaged(const Vector &true_mm) const noexcept { return true_mm + displacement(true_mm); }
  // No result where the iteration does not settle within 1e-4 mm.
  [[nodiscard]] std::optional<Vector> to_true(const Vector &imaged_mm) const noexcept;
  // Volume of the image of a small true volume, over that volume.
  [[nodiscard]] double volume_ratio(const Vector &true_mm) const noexcept;

private:
  void prepare();

  image::Image<Eigen::Vector3f, 3> displacement_;
  image::Image<float, 3> error_;
  double max_error_95_mm_ = 2.0, table_error_mm_ = 0.0;
  Eigen::Matrix4d T_index_mm_ = Eigen::Matrix4d::Identity(), T_error_index_mm_ = Eigen::Matrix4d::Identity();
};

} // namespace bregma::mri
