// The simulated session as an estimator sees it: frame, scans, and the field as a perfect correction.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "algorithms/mri/coils/robot_registration.hpp"
#include "drivers/sim/scanner/simulated_scanner.hpp"

namespace bregma::mri::test {

inline CoilFrame drawn_frame() {
  CoilFrame out;
  out.name = "tuna";
  for (const sim::scanner::CoilDesign &c : sim::scanner::frame_design()) {
    out.coils.push_back({c.name, c.group, c.position_mm});
  }
  return out;
}

inline std::vector<int> coils_of(const CoilFrame &frame, const std::vector<std::string> &groups) {
  std::vector<int> out;
  for (std::size_t i = 0; i < frame.coils.size(); ++i) {
    for (const std::string &group : groups) {
      if (frame.coils[i].group == group) {
        out.push_back(static_cast<int>(i));
      }
    }
  }
  return out;
}

// Background and foreground of one stack, with the CoilScan that refers to them; opposed: also with the read-out
// reversed.
struct Pair {
  Stack background, foreground;
  Stack reversed_background, reversed_foreground;
  CoilScan scan;
};
inline std::unique_ptr<Pair> pair_of(sim::scanner::SimulatedScanner &scanner, const CoilFrame &frame,
                                     const sim::scanner::StackPlan &plan, const std::vector<std::string> &groups,
                                     const std::string &name, bool opposed = false) {
  auto out = std::make_unique<Pair>();
  const sim::scanner::Protocol protocol = sim::scanner::coil_protocol(plan.slices);
  out->background = scanner.background(protocol, plan);
  out->foreground = scanner.foreground(protocol, plan, groups);
  out->scan = {name, &out->background, &out->foreground, nullptr, coils_of(frame, groups)};
  if (opposed) {
    sim::scanner::StackPlan reversed = plan;
    reversed.read_reversed = true;
    out->reversed_background = scanner.background(protocol, reversed);
    out->reversed_foreground = scanner.foreground(protocol, reversed, groups);
    out->scan.reversed_background = &out->reversed_background;
    out->scan.reversed_foreground = &out->reversed_foreground;
  }
  return out;
}

// The gradients of the simulated scanner, inverted by iteration: B0 remains.
inline PointCorrection true_gradients(const sim::scanner::ScannerField &field) {
  return [&field](const Vector3d &shown) -> std::optional<CorrectedPoint> {
    Vector3d r = shown;
    for (int i = 0; i < 20; ++i) {
      r = shown - field.gradient_mm(r);
    }
    return CorrectedPoint{r, Vector3d::Constant(0.15)};
  };
}

} // namespace bregma::mri::test
