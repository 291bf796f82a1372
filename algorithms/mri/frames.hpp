// The frames of a magnetic resonance scanner and the transforms between them, from plain values of a slice's header.
//
// [Tuna 2022, table 1, figure 4, (9)]: q_D = g_DP g_PG g_GS q_S, here
//
//   T_device_slice = T_device_patient * T_patient_gradient * T_gradient_slice
//
// clang-format off
// | frame    | acronym | origin                                | axes                                                  |
// | -------- | ------- | ------------------------------------- | ----------------------------------------------------- |
// | Slice    | SCS     | centre of the slice's first pixel     | x along a row, y along a column, z = x cross y        |
// | Gradient | GCS     | centre of the slice's field of view   | x along the read-out, z the slice's normal, y = z x x |
// | Patient  | PCS     | isocentre                             | DICOM's: left, posterior, superior (LPS)              |
// | Device   | DCS     | isocentre                             | seen from the front: right, up, towards the viewer    |
// | Base     | BCS     | the robot's base                      | the robot's                                           |
// clang-format on
//
// T_gradient_slice is the same for all slices of a series, T_device_patient for all series of a patient position. Only
// T_patient_gradient differs from slice to slice. So a transform of the base relative to Slice, as in (11), differs
// from slice to slice as well; the constant one is T_base_device.
//
// The table may move between series. PCS and DCS share their origin only if the header's positions are relative to the
// isocentre; this is the case while the table is at the position at which the patient's position was defined.
//
// Units: mm, rad. Pure functions, any thread.
#pragma once

#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::mri {

namespace frame {
struct Slice;
struct Gradient;
struct Patient;
struct Device;
struct Base;
} // namespace frame

using geometry::Rigid3;
using geometry::Vector3d;

// DICOM (0018,5100): head or feet first; supine, prone, on the right or on the left side.
enum class PatientPosition { kHfs, kHfp, kHfdr, kHfdl, kFfs, kFfp, kFfdr, kFfdl };
[[nodiscard]] const char *name(PatientPosition position) noexcept; // "HFS"
[[nodiscard]] tl::expected<PatientPosition, std::string> parse_patient_position(std::string_view text);

[[nodiscard]] Rigid3<frame::Device, frame::Patient> T_device_patient(PatientPosition position);
// Image (RAS) is Patient (LPS) after half a turn about its third axis.
[[nodiscard]] Rigid3<geometry::frame::Image, frame::Patient> T_image_patient();

// Direction of phase encoding or read-out in the slice, by the index that increases.
enum class EncodingDirection { kUnknown, kRowPositive, kRowNegative, kColumnPositive, kColumnNegative };
// Unit vector in Slice; zero for kUnknown.
[[nodiscard]] Vector3d direction_in_slice(EncodingDirection direction) noexcept;

// DICOM values of one slice.
struct SliceHeader {
  Vector3d position_mm = Vector3d::Zero();   // (0020,0032), centre of the first pixel in Patient
  Vector3d along_row = Vector3d::UnitX();    // (0020,0037), direction of increasing columns, unit length
  Vector3d along_column = Vector3d::UnitY(); // direction of increasing rows
  double row_spacing_mm = 1.0;               // (0028,0030), first value: from a row to the next
  double column_spacing_mm = 1.0;            // second value: from a column to the next
  int rows = 1;                              // (0028,0010)
  int columns = 1;                           // (0028,0011)
  double thickness_mm = 0.0;                 // (0018,0050); 0: not stated
  PatientPosition patient_position = PatientPosition::kHfs;
  EncodingDirection read_out = EncodingDirection::kUnknown; // perpendicular to the phase encoding
};

class SlicePlane {
public:
  // Otherwise a sentence with field and value: numbers that are not finite, directions that are not of unit length or
  // not perpendicular (within 1e-3, as files round them), spacings or sizes that are not positive. Directions are
  // made perpendicular here. An unknown read-out is taken along the rows.
  [[nodiscard]] static tl::expected<SlicePlane, std::string> from(const SliceHeader &header);

  [[nodiscard]] const SliceHeader &header() const { return header_; }
  [[nodiscard]] const Rigid3<frame::Gradient, frame::Slice> &T_gradient_slice() const { return T_gradient_slice_; }
  [[nodiscard]] const Rigid3<frame::Patient, frame::Gradient> &T_patient_gradient() const {
    return T_patient_gradient_;
  }
  [[nodiscard]] Rigid3<frame::Patient, frame::Slice> T_patient_slice() const {
    return T_patient_gradient_ * T_gradient_slice_;
  }
  // [Tuna 2022, (9)]
  [[nodiscard]] Rigid3<frame::Device, frame::Slice> T_device_slice() const {
    return T_device_patient(header_.patient_position) * T_patient_slice();
  }

  // A pixel, which need not be whole, in Slice.
  [[nodiscard]] Vector3d pixel_mm(double column, double row) const {
    return {column * header_.column_spacing_mm, row * header_.row_spacing_mm, 0.0};
  }
  [[nodiscard]] Vector3d normal() const { return header_.along_row.cross(header_.along_column); } // in Patient

private:
  SliceHeader header_;
  Rigid3<frame::Gradient, frame::Slice> T_gradient_slice_;
  Rigid3<frame::Patient, frame::Gradient> T_patient_gradient_;
};

// The orientation of a plane as scanners print it: "T>C38.3>S10.0" is transverse (T), tilted towards coronal (C) by
// 38.3 degrees and then towards sagittal (S) by 10.0 degrees. Vendors do not publish the sign. Here a positive angle
// turns the plane's normal, which starts along the main axis of Patient (S: left, C: posterior, T: superior), towards
// the positive next axis: normal = cos b (cos a e_T + sin a e_C) + sin b e_S.
enum class Orientation { kSagittal, kCoronal, kTransverse, kOblique, kDoubleOblique };
[[nodiscard]] const char *name(Orientation orientation) noexcept; // "double oblique"

// The unit normal in Patient. Letters or words (Sag, Cor, Tra) and blanks between are accepted, as in "Tra>Cor 38.3".
// Otherwise a sentence: an unknown or repeated axis, a number that is missing or above 90 degrees, text left over.
[[nodiscard]] tl::expected<Vector3d, std::string> parse_orientation(std::string_view text);

// The main axis is that of the largest component of the normal, then the second largest; one decimal; angles that round
// to 0.0 are left out. A normal and its opposite print the same.
[[nodiscard]] std::string print_orientation(const Vector3d &normal_patient);
[[nodiscard]] Orientation orientation_of(const Vector3d &normal_patient);

// Row and column directions that a scanner gives to a plane without rotation in the plane: columns of transverse planes
// have no component towards the left, rows of the others none towards the head.
struct PlaneDirections {
  Vector3d along_row, along_column;
};
[[nodiscard]] PlaneDirections plane_directions(const Vector3d &normal_patient);

} // namespace bregma::mri
