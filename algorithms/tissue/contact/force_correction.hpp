// What a measured force along the probe says about the model: how stiff the tissue really is while the tip indents it,
// that it has ruptured, and how hard it is to cut.
//
// Under a probe whose way is known, displacements do not depend on the stiffness, forces are proportional to it: the
// scale is the least-squares quotient of measured and modelled force, forgetting with a time constant. One thread; no
// allocation.
#pragma once

#include <algorithm>

namespace bregma::tissue {

class ForceCorrection {
public:
  void reset() noexcept { *this = {}; }
  void touch() noexcept { peak_N_ = smoothed_N_ = 0.0; } // a new indentation begins

  // While the tip indents. Where one of the two feels nothing yet, the surfaces do not lie where each takes them for,
  // which says nothing about stiffness.
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

  // The measured force has fallen from its peak as it does when a membrane gives way, and by more than noise does.
  [[nodiscard]] bool dropped() const noexcept {
    return peak_N_ - smoothed_N_ > std::max(3.0 * kMinForce_N, (1.0 - kDrop) * peak_N_);
  }

  // While the tip cuts: the cutting force takes up what the model lacks or has too much.
  void cut(double modelled_N, double measured_N, double elapsed_s) noexcept {
    extra_cutting_N_ += std::min(1.0, elapsed_s / kCutting_s) * (measured_N - modelled_N);
  }

  [[nodiscard]] double scale() const noexcept { return scale_; }
  [[nodiscard]] double extra_cutting_N() const noexcept { return extra_cutting_N_; }

private:
  static constexpr double kMinForce_N = 0.01; // below this, a sensor's noise is as large
  static constexpr double kMemory_s = 2.0;
  static constexpr double kSmoothing_s = 0.05; // of the measured force
  static constexpr double kCutting_s = 0.5;
  static constexpr double kDrop = 0.7;
  static constexpr double kMinScale = 0.1, kMaxScale = 10.0;

  double cross_ = 0.0, square_ = 0.0, scale_ = 1.0;
  double smoothed_N_ = 0.0, peak_N_ = 0.0;
  double extra_cutting_N_ = 0.0;
};

} // namespace bregma::tissue
