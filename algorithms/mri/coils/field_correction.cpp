#include "algorithms/mri/coils/field_correction.hpp"

#include <cmath>
#include <optional>
#include <utility>

#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::mri {

namespace {

auto T_field_device_of(PatientPosition position) { return T_image_patient() * T_device_patient(position).inverse(); }

} // namespace

PointCorrection correction_by(std::shared_ptr<const FieldTable> field, PatientPosition position) {
  const auto T_field_device = T_field_device_of(position);
  const double per_sigma = std::sqrt(uncertainty::chi_square_upper_quantile(0.05, 3.0));
  return [field = std::move(field), T_field_device,
          per_sigma](const Vector3d &device_mm) -> std::optional<CorrectedPoint> {
    const auto real = field->to_true(T_field_device * device_mm);
    if (!real) {
      return std::nullopt;
    }
    const FieldTable::Sample known = field->sample(*real);
    if (known.coverage == Coverage::kUnknown) {
      return std::nullopt;
    }
    return CorrectedPoint{T_field_device.inverse() * *real, Vector3d::Constant(known.error_95_mm / per_sigma)};
  };
}

MappedB0 mapped_b0(const ScanFields &fields, PatientPosition position, const Eigen::Vector3d &mm_per_Hz) {
  const auto T_field_device = T_field_device_of(position);
  const Vector3d in_device = T_field_device.rotation().inverse() * mm_per_Hz;
  return [fields, T_field_device, in_device](const Vector3d &device_mm) -> Vector3d {
    return fields.b0_Hz(T_field_device * device_mm) * in_device;
  };
}

} // namespace bregma::mri
