// Corrects slices as they come, each with the neighbours of its series that have come before it (mri/correction.hpp),
// and once more when those have come that were missing. The geometry of a plane is kept, so that the next slice of the
// same plane takes a millisecond.
//
// Units: mm, frame Device. One thread.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/mri/correction.hpp"
#include "base/result.hpp"
#include "idl/topics.hpp"
#include "server/stages/scanner/field_measurement.hpp"

namespace bregma::server {

// A slice with its own pixels.
struct OwnedSlice {
  OwnedSlice() = default;
  explicit OwnedSlice(const wire::ImageSlice &slice);
  // Refers to the pixels of this object.
  [[nodiscard]] wire::ImageSlice view() const;

  wire::ImageSlice header{}; // without pixels
  std::vector<std::uint16_t> pixels;
};

struct CorrectedPixels {
  wire::ImageSlice header{}; // of the slice, without pixels
  std::vector<std::uint16_t> pixels;
  mri::CorrectionSummary summary;
  double missing_fraction = 0.0;
  wire::DistortionCorrection correction = bregma_wire_CORRECTION_UNKNOWN;
};

class SliceCorrector {
public:
  explicit SliceCorrector(bool jacobian) : jacobian_(jacobian) {}

  [[nodiscard]] bool corrects_brightness() const { return jacobian_; }

  // Refused with a sentence: a slice that is or may be corrected already, or of an unknown patient position.
  // Precondition: an accepted slice.
  [[nodiscard]] base::Result<CorrectedPixels> correct(const OwnedSlice &slice, const ScannerField &field);

  // An earlier slice of the same series, corrected again: its neighbours are complete now, or the series has ended and
  // fewer are missing than before. Each slice comes at most once. Call it after correct() until there is none.
  [[nodiscard]] std::optional<CorrectedPixels> correct_again();

private:
  struct Plane {
    mri::PlaneGeometry geometry;
    std::unique_ptr<mri::PlaneCorrection> correction;
  };
  struct Window { // slices that are there around one, and its plane
    int first = 0, last = 0;
    const mri::PlaneCorrection *plane = nullptr;
    double missing_fraction = 0.0;
  };
  void remember(const OwnedSlice &slice);
  [[nodiscard]] bool has(int index) const;
  [[nodiscard]] Window window_of(int index);
  [[nodiscard]] CorrectedPixels correct_at(int index, const Window &window);
  [[nodiscard]] const mri::PlaneCorrection &plane(const mri::PlaneGeometry &geometry);

  bool jacobian_;
  std::shared_ptr<const mri::ScanFields> scans_; // of the table
  Eigen::Vector3d mm_per_Hz_ = Eigen::Vector3d::Zero();
  std::shared_ptr<const mri::FieldTable> table_; // of the planes: that of the read-out of the series
  std::vector<Plane> planes_;                    // used last comes last
  std::uint32_t series_ = 0;
  std::vector<OwnedSlice> received_; // of the series, by index; without pixels: not received
  // Fraction that was missing when the slice was corrected; 0: complete, or not received, or corrected again.
  std::vector<double> missing_;
  int newest_ = 0;                                             // index of the last slice
  mri::PatientPosition position_ = mri::PatientPosition::kHfs; // of the field
};

} // namespace bregma::server
