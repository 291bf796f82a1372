// Corrects slices as they come, each with the neighbours of its series that have come before it (mri/correction.hpp).
// The geometry of a plane is kept, so that the next slice of the same plane takes a millisecond.
//
// Units: mm, frame Device. One thread.
#pragma once

#include <cstdint>
#include <memory>
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

private:
  struct Plane {
    mri::PlaneGeometry geometry;
    std::unique_ptr<mri::PlaneCorrection> correction;
  };
  void remember(const OwnedSlice &slice);
  [[nodiscard]] const mri::PlaneCorrection &plane(const mri::PlaneGeometry &geometry);

  bool jacobian_;
  std::shared_ptr<const mri::FieldTable> table_; // of the planes
  std::vector<Plane> planes_;                    // used last comes last
  std::uint32_t series_ = 0;
  std::vector<OwnedSlice> received_; // of the series, by index; without pixels: not received
};

} // namespace bregma::server
