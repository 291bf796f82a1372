// The correction of single points by a scanner's distortion field, for the registration by coils.
#pragma once

#include <memory>

#include "algorithms/mri/coils/robot_registration.hpp"
#include "algorithms/mri/field_table.hpp"
#include "algorithms/mri/scan_fields.hpp"

namespace bregma::mri {

// Points of Device corrected by a field whose frame is Image (RAS) of `position`, in which it was measured. Nothing
// where the field is unknown. The stated error is spread evenly over the coordinates. Thread-safe.
[[nodiscard]] PointCorrection correction_by(std::shared_ptr<const FieldTable> field, PatientPosition position);

// What B0 did in scans with this mm_per_Hz (frame of the fields) when it was mapped, by fields that hold its part.
[[nodiscard]] MappedB0 mapped_b0(const ScanFields &fields, PatientPosition position, const Eigen::Vector3d &mm_per_Hz);

} // namespace bregma::mri
