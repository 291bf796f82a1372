#include "algorithms/mri/scan_fields.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::mri {

namespace {

using Eigen::Vector3d;
using Displacements = image::Image<Eigen::Vector3f, 3>;
using Errors = image::Image<float, 3>;

bool same_grid(const image::Grid<3> &a, const image::Grid<3> &b) {
  return a.size == b.size && a.T_image_index.isApprox(b.T_image_index);
}

// Displacement by B0 at the nodes of the gradients' table, which also decides what is an extrapolation.
std::shared_ptr<const FieldTable> table_of(const HarmonicSeries &b0_Hz, const FieldTable &gradients,
                                           const Vector3d &mm_per_Hz) {
  Displacements displacement = gradients.displacements();
  for (std::size_t i = 0; i < displacement.voxels.size(); ++i) {
    displacement.voxels[i] = (b0_Hz(displacement.pixel_mm(i)) * mm_per_Hz).cast<float>();
  }
  Errors error = gradients.signed_errors();
  const double mm_95 = mm_per_Hz.norm() * std::sqrt(uncertainty::chi_square_upper_quantile(0.05, 1.0));
  for (std::size_t i = 0; i < error.voxels.size(); ++i) {
    error.voxels[i] =
        std::copysign(static_cast<float>(mm_95 * b0_Hz.estimate(error.pixel_mm(i)).sigma), error.voxels[i]);
  }
  return std::make_shared<const FieldTable>(std::move(displacement), std::move(error), gradients.max_error_95_mm());
}

} // namespace

ScanFields::ScanFields(std::shared_ptr<const FieldTable> of_one_read_out, const Vector3d &mm_per_Hz)
    : table_(std::move(of_one_read_out)), mm_per_Hz_(mm_per_Hz) {}

ScanFields::ScanFields(std::shared_ptr<const FieldTable> gradients, std::shared_ptr<const FieldTable> by_b0,
                       const Vector3d &mm_per_Hz)
    : table_(std::move(gradients)), b0_(std::move(by_b0)), mm_per_Hz_(mm_per_Hz) {
  if (!same_grid(table_->displacements(), b0_->displacements()) ||
      !same_grid(table_->signed_errors(), b0_->signed_errors())) {
    throw std::invalid_argument("the parts of gradients and B0 have different grids");
  }
  if (!(mm_per_Hz.norm() > 0.0)) {
    throw std::invalid_argument("the movement per Hz of the part of B0 is missing");
  }
}

ScanFields::ScanFields(const SeparatedField &field, const Vector3d &mm_per_Hz, double spacing_mm, double margin_mm,
                       int threads)
    : table_(std::make_shared<const FieldTable>(field.gradients, spacing_mm, margin_mm, threads)),
      b0_(table_of(field.b0_Hz, *table_, mm_per_Hz)), mm_per_Hz_(mm_per_Hz) {}

std::shared_ptr<const FieldTable> ScanFields::of_scan(const Vector3d &mm_per_Hz) const {
  if (!has_b0()) {
    return table_;
  }
  const Eigen::Vector3f per_mm = (mm_per_Hz_ / mm_per_Hz_.squaredNorm()).cast<float>();
  const Eigen::Vector3f movement = mm_per_Hz.cast<float>();
  Displacements displacement = table_->displacements();
  for (std::size_t i = 0; i < displacement.voxels.size(); ++i) {
    displacement.voxels[i] += per_mm.dot(b0_->displacements().voxels[i]) * movement;
  }
  Errors error = table_->signed_errors();
  const auto scale = static_cast<float>(mm_per_Hz.norm() / mm_per_Hz_.norm());
  for (std::size_t i = 0; i < error.voxels.size(); ++i) {
    error.voxels[i] =
        std::copysign(std::hypot(error.voxels[i], scale * b0_->signed_errors().voxels[i]), error.voxels[i]);
  }
  return std::make_shared<const FieldTable>(std::move(displacement), std::move(error), table_->max_error_95_mm());
}

bool ScanFields::is_opposite(const Vector3d &mm_per_Hz) const {
  constexpr double kOpposite = -0.5; // cosine
  return !has_b0() && mm_per_Hz_.dot(mm_per_Hz) < kOpposite * mm_per_Hz_.norm() * mm_per_Hz.norm();
}

double ScanFields::b0_Hz(const Vector3d &true_mm) const noexcept {
  return has_b0() ? b0_->displacement(true_mm).dot(mm_per_Hz_) / mm_per_Hz_.squaredNorm() : 0.0;
}

} // namespace bregma::mri
