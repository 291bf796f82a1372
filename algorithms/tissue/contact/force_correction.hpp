// Corrects the model by the measured force along the probe: the tissue's stiffness during the indentation, the rupture,
// and the cutting force.
//
// Under a prescribed motion of the probe, displacements do not depend on the stiffness and forces are proportional to
// it. The scale is the least-squares quotient of measured and modelled force, with exponential forgetting. One thread;
// no allocation.
#pragma once

#include <algorithm>

namespace bregma::tissue {

class ForceCorrection {
public:
  void reset() noexcept { *this = {}; }
  void touch() noexcept { peak_N_ = smoothed_N_ = 0.0; } // a new indentation begins

  // During the indentation. If one of the two forces is still zero, the positions of model and tissue surface differ,
  // which contains no information about the stiffness.
  void indent(double modelled_N, double measured_N, double elapsed_s) noexcept {
    smoothed_N_ += std::min(1.0, elapsed_s / kSmoothing_s) * (measured_N - smoothed_N_);
    peak_N_ = std::max(peak_N_, smoothed_N_);
    if (modelled_N < kMinForce_N || smoothed_N_ < kMinForce_N) {
      return;
    }
    const double keep = 1.0 - std::min(1.0, elapsed_s / kMemory_s);
    cross_ = keep * cross_ + modelled_N * measured_N * elapsed_s;
    square_ = keep * square_ + modelled_N * modelled_N * elapsed_s;
    scale_ = std::clamp(cross_ / square_, kMinScale, kMaxScale);
  }

  // The measured force has dropped from its peak as at the rupture of a membrane, and by more than the noise.
  [[nodiscard]] bool dropped() const noexcept {
    return peak_N_ - smoothed_N_ > std::max(3.0 * kMinForce_N, (1.0 - kDrop) * peak_N_);
  }

  // During cutting: corrects the cutting force by the difference of measured and modelled force.
  void cut(double modelled_N, double measured_N, double elapsed_s) noexcept {
    extra_cutting_N_ += std::min(1.0, elapsed_s / kCutting_s) * (measured_N - modelled_N);
  }

  [[nodiscard]] double scale() const noexcept { return scale_; }
  [[nodiscard]] double extra_cutting_N() const noexcept { return extra_cutting_N_; }

private:
  static constexpr double kMinForce_N = 0.01; // below this force the sensor's noise dominates
  static constexpr double kMemory_s = 2.0;
  static constexpr double kSmoothing_s = 0.05; // smoothing of the measured force
  static constexpr double kCutting_s = 0.5;
  static constexpr double kDrop = 0.7;
  static constexpr double kMinScale = 0.1, kMaxScale = 10.0;

  double cross_ = 0.0, square_ = 0.0, scale_ = 1.0;
  double smoothed_N_ = 0.0, peak_N_ = 0.0;
  double extra_cutting_N_ = 0.0;
};

} // namespace bregma::tissue
