#include "tests/unit/server/stages/tracked_tool.hpp"

#include <utility>

#include "server/stages/wire_values.hpp"
#include "tests/support/measured_markers.hpp"

namespace bregma::server::tracking_test {

namespace {

const Eigen::Quaterniond kFacingTheCamera = Eigen::Quaterniond(0.2, 0.93, 0.25, 0.15).normalized(); // of both bodies
const Vector3d kReference_mm(-80.0, 30.0, 1600.0);                                                  // in the tracker

} // namespace

TrackedTool::TrackedTool(std::int64_t period_ns, unsigned seed, const NavigationParameters &parameters,
                         casefile::Case a_case)
    : pipeline(parameters, events), period_ns_(period_ns), parameters_(parameters), rng_(seed) {
  case_ = std::make_unique<LoadedCase>(std::make_shared<const casefile::Case>(std::move(a_case)), 12.0, 100);
  pipeline.handle(CaseChanged{1, case_.get()});
  ToolTip tip{};
  (void)wire::set_name(tip.tool, "Stylus");
  tip.tip_mm = array_of(case_->data->tool("Stylus")->nominal_tip_mm);
  pipeline.handle(NavigationMessage(tip));
  pipeline.handle(NavigationMessage(RegistrationAccepted{1, {{1, 0, 0, 0}, {0, 0, 0}}, {}, {}}));
  pipeline.handle(NavigationMessage(SessionChanged{bregma_wire_SESSION_VERIFIED, true}));
}

wire::TrackedTool TrackedTool::measured(const casefile::ToolModel &model, const T_Tracker &T_tracker_tool) {
  return test::measured_markers(model, T_tracker_tool,
                                {parameters_.marker_sigma_lateral_mm, parameters_.marker_sigma_depth_mm}, rng_);
}

wire::TrackerFrame TrackedTool::frame(std::uint64_t number, const Vector3d &tip_mm) {
  const T_Tracker reference(kFacingTheCamera, kReference_mm);
  const casefile::ToolModel &model = *case_->data->tool("Stylus");
  const T_Tracker stylus(kFacingTheCamera, reference * tip_mm - kFacingTheCamera * model.nominal_tip_mm);
  wire::TrackerFrame out{};
  (void)wire::set_name(out.device, "Tracker");
  out.frame = number;
  out.device_time_ns = out.sent_time_ns = acquired_ns(number);
  out.period_ns = period_ns_;
  out.tool_count = 2;
  out.tools[0] = measured(*case_->data->reference(), reference);
  out.tools[1] = measured(model, stylus);
  return out;
}

void TrackedTool::take(const wire::TrackerFrame &frame, std::int64_t acquired_ns, std::int64_t delay_ns) {
  pipeline.on_frame(frame, {acquired_ns, 0, period_ns_}, acquired_ns + delay_ns);
}

void TrackedTool::move_to(std::uint64_t number, const Vector3d &tip_mm) {
  take(frame(number, tip_mm), acquired_ns(number));
}

} // namespace bregma::server::tracking_test
