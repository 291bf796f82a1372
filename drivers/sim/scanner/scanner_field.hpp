// The field of a simulated scanner: where it believes that a spin is.
//
// Gradient coils: a spin at r is believed to be at r + g(r), g a sum of solid harmonics of orders 2 to 7 (or of smooth
// bumps) per axis. B0: its deviation in Hz moves a spin along the read-out by pixel / bandwidth, and along the slice by
// thickness / bandwidth of the pulse. Both are tabulated when the scanner is made, and the table is the truth: nothing
// evaluates the harmonics again. Frame: device (isocentre, mm). Immutable after its construction; safe to share.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace bregma::sim::scanner {

// Real solid harmonics r^n P_n^m(cos) {cos, sin}(m phi) of orders first..last at r / radius, unnormalised signs of
// Condon and Shortley left out, each divided by its largest value on the unit sphere (to within a few percent).
[[nodiscard]] std::vector<double> solid_harmonics(const Eigen::Vector3d &r_mm, double radius_mm, int first, int last);

enum class FieldKind { kNone, kHarmonics, kBumps };

struct FieldOptions {
  FieldKind kind = FieldKind::kHarmonics;
  double mean_mm = 1.20; // of the paper's phantom: distortion after its best rigid motion is removed
  double max_mm = 4.14;
  double b0_Hz = 40.0; // RMS on the phantom
};

class ScannerField {
public:
  static constexpr double kHalf_mm = 180.0; // the table's half width; beyond it the border's value holds
  // sample_mm: where mean, maximum and RMS hold, at least one point.
  ScannerField(const FieldOptions &options, std::span<const Eigen::Vector3d> sample_mm, std::uint64_t seed);

  // Displacement by the gradients, mm.
  [[nodiscard]] Eigen::Vector3d gradient_mm(const Eigen::Vector3d &r_mm) const {
    return at(r_mm).head<3>().cast<double>();
  }
  [[nodiscard]] double b0_Hz(const Eigen::Vector3d &r_mm) const { return static_cast<double>(at(r_mm)[3]); }
  // x, y, z (mm) and Hz.
  [[nodiscard]] Eigen::Array4f at(const Eigen::Vector3d &r_mm) const;

  // A field whose B0 has this added: what enters the bore after the map was made.
  [[nodiscard]] ScannerField with_b0(const std::function<double(const Eigen::Vector3d &)> &extra_Hz) const;
  // What a vendor's correction leaves: B0 alone.
  [[nodiscard]] ScannerField without_gradients() const;

  struct Distortion {
    double mean_mm = 0.0;
    double max_mm = 0.0;
  };
  // Of the gradients on a sample, after the best small rigid motion.
  [[nodiscard]] Distortion distortion(std::span<const Eigen::Vector3d> sample_mm) const;

private:
  static constexpr double kStep_mm = 5.0;
  static constexpr int kNodes = 73; // 360 mm / 5 mm + 1
  std::vector<Eigen::Array4f> table_;
};

} // namespace bregma::sim::scanner
