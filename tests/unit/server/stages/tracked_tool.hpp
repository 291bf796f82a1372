// A navigation pipeline with a registered and verified case, and tracker frames of a Stylus at given positions of its
// tip. The markers scatter as the pipeline assumes. Image and Reference coincide, and the registration is exact, so
// that the stated errors are those of the tracking.
#pragma once

#include <memory>
#include <random>
#include <vector>

#include "server/stages/navigation/pipeline.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace bregma::server::tracking_test {

inline constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;

class TrackedTool {
public:
  explicit TrackedTool(std::int64_t period_ns, unsigned seed = 1, const NavigationParameters &parameters = {},
                       casefile::Case a_case = tests::sample_case("/cases/sample"));

  // The frame of this number with the tip there, in Reference; both bodies are visible.
  [[nodiscard]] wire::TrackerFrame frame(std::uint64_t number, const geometry::Vector3d &tip_mm);
  // Passes a frame that was exposed at this time and arrives delay_ns later.
  void take(const wire::TrackerFrame &frame, std::int64_t acquired_ns, std::int64_t delay_ns = 4'000'000);
  // frame() and take() of frame n at kStart_ns + n periods.
  void move_to(std::uint64_t number, const geometry::Vector3d &tip_mm);

  [[nodiscard]] std::int64_t acquired_ns(std::uint64_t number) const {
    return kStart_ns + static_cast<std::int64_t>(number) * period_ns_;
  }
  [[nodiscard]] const wire::NavigationState &stylus() const { return pipeline.states()[0]; }
  [[nodiscard]] bool has_pose() const {
    return stylus().status == bregma_wire_POSE_LIVE || stylus().status == bregma_wire_POSE_UNVERIFIED;
  }
  static wire::TrackedTool &reference_of(wire::TrackerFrame &frame) { return frame.tools[0]; }
  static wire::TrackedTool &stylus_of(wire::TrackerFrame &frame) { return frame.tools[1]; }

  NavigationEvents events;
  NavigationPipeline pipeline;

private:
  using T_Tracker = geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool>;
  [[nodiscard]] wire::TrackedTool measured(const casefile::ToolModel &model, const T_Tracker &T_tracker_tool);

  std::int64_t period_ns_;
  NavigationParameters parameters_;
  std::mt19937 rng_;
  std::unique_ptr<LoadedCase> case_;
};

} // namespace bregma::server::tracking_test
