// Slices corrected in real time: for each pixel of a plane, where its tissue is in the distorted slices.
//
// The geometry of a plane is computed once (milliseconds for 256 x 256), then each slice of it takes a fraction of a
// millisecond. A pixel of the corrected slice at p takes the value at p + displacement(p), linearly interpolated in the
// slice and, where neighbouring slices are there, between slices. Beyond the outermost slice the value is that of the
// outermost one; `missing_fraction` counts these pixels. Pixels outside the image are 0.
//
// Jacobian correction multiplies by the change of volume, since tissue that is imaged into a smaller volume is
// brighter.
//
// Units: mm. apply() is thread-safe and does not allocate.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "algorithms/mri/field_table.hpp"

namespace bregma::mri {

struct PlaneGeometry {
  // (column, row, slice, 1) to mm, in the frame of the field; slice 0 is the plane that is corrected. The third axis is
  // the step to the next slice; without neighbours, any vector along the normal.
  Eigen::Matrix4d T_field_index = Eigen::Matrix4d::Identity();
  int columns = 0, rows = 0;
};

struct CorrectionSummary {
  double max_shift_mm = 0.0;
  double max_through_plane_mm = 0.0; // part of it along the normal
  double extrapolated_fraction = 0.0;
  double unknown_fraction = 0.0; // pixels whose stated error exceeds the field's limit, or outside its grid
  double error_95_mm = 0.0;      // largest stated error of the other pixels
};

class PlaneCorrection {
public:
  // Throws std::invalid_argument for fewer than two columns or rows, or axes that are not independent.
  PlaneCorrection(const FieldTable &field, const PlaneGeometry &geometry, bool jacobian = false);

  // slices: all slices of the stack at equal steps, row-major, columns * rows each; `index` is the one that lies at the
  // plane. out: columns * rows. One slice: correction in the plane only.
  template <class Pixel>
  void apply(std::span<const std::span<const Pixel>> slices, int index, std::span<Pixel> out) const;

  [[nodiscard]] const CorrectionSummary &summary() const { return summary_; }
  // Fraction of the pixels whose tissue lies more than half a step beyond the stack's ends.
  [[nodiscard]] double missing_fraction(int slices, int index) const;

private:
  int columns_, rows_;
  struct Source {
    float column, row, slice, factor;
  };
  std::vector<Source> sources_;
  CorrectionSummary summary_;
};

extern template void PlaneCorrection::apply(std::span<const std::span<const std::uint16_t>>, int,
                                            std::span<std::uint16_t>) const;
extern template void PlaneCorrection::apply(std::span<const std::span<const float>>, int, std::span<float>) const;

} // namespace bregma::mri
