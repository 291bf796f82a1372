#include "tests/unit/cli/report_session_maker.hpp"

#include <cmath>

#include "idl/commands.hpp"

namespace bregma::test {
namespace {

void name(wire::Name &field, const char *text) { ASSERT_TRUE(wire::set_name(field, text)); }

} // namespace

wire::RegistrationState accepted_registration(double shift_mm) {
  wire::RegistrationState state{};
  name(state.reference, "Reference");
  state.revision = 9;
  state.accepted_revision = 9;
  state.status = bregma_wire_REGISTRATION_ACCEPTED;
  state.T_image_reference = {{1, 0, 0, 0}, {10.0 + shift_mm, 0, 0}};
  state.accepted_T_image_reference = state.T_image_reference;
  state.fiducial_count = 8;
  state.surface_count = 300;
  state.fre_mm = 0.61;
  state.surface_rms_mm = 0.45;
  return state;
}

void put_command(casefile::SessionWriter &writer, std::int64_t time_ns, std::uint64_t id, wire::CommandKind kind,
                 wire::SessionState after, double value_mm, const char *point) {
  wire::Command command{};
  name(command.client, "tester");
  command.id = id;
  command.kind = kind;
  if (kind == bregma_wire_COMMAND_CHECK_TOUCH) {
    ASSERT_EQ(wire::fill_command(command, kind, {"Stylus", point}), "");
  }
  put(writer, time_ns, command);
  wire::CommandReply reply{};
  name(reply.client, "tester");
  reply.id = id;
  reply.result = bregma_wire_COMMAND_DONE;
  reply.session = after;
  reply.value_mm = value_mm;
  put(writer, time_ns, reply);
}

void write_run(casefile::SessionWriter &writer, const RunPlan &plan) {
  put(writer, kStart_ns, accepted_registration(plan.registration_shift_mm));
  for (int k = 0; k < plan.frames; ++k) {
    const std::int64_t exposed_ns = kStart_ns + 4 * kMs * (k + 1);
    wire::TrackerFrame frame{};
    name(frame.device, "Tracker");
    frame.frame = static_cast<std::uint64_t>(k) + 1;
    put(writer, exposed_ns, frame);

    wire::NavigationState state{};
    name(state.tool, "Probe");
    name(state.trajectory, "Biopsy");
    name(state.nearest_structure, "Precentral_L");
    state.frame = frame.frame;
    state.acquired_time_ns = exposed_ns;
    state.frame_sent_time_ns = exposed_ns + 2 * kMs;
    state.published_time_ns = state.frame_sent_time_ns + 10'000LL * (k + 1); // 0.01, 0.02, ... ms
    state.status = bregma_wire_POSE_LIVE;
    state.session = bregma_wire_SESSION_NAVIGATING;
    const bool at_target = k >= plan.first_at_target;
    const double true_x = 20.0;
    state.T_image_tip = {{1, 0, 0, 0}, {true_x + plan.error_mm(k), 5.0, -3.0}};
    state.tre_rms_mm = 0.9;
    state.tre_95 = {{1.0, 0.8, 0.6}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    state.remaining_depth_mm = at_target ? 0.3 : 40.0;
    state.distance_to_target_mm = at_target ? 0.7 : 40.0;
    state.lateral_deviation_mm = at_target ? 0.4 : 1.6;
    state.nearest_structure_mm = 12.0 - 0.04 * k; // nearest at the end
    put(writer, state.published_time_ns, state);
    if (plan.truth) {
      wire::SimulatedTruth truth{};
      name(truth.device, "Tracker");
      truth.frame = frame.frame;
      truth.time_ns = exposed_ns;
      truth.T_image_reference = {{1, 0, 0, 0}, {10.0, 0, 0}};
      truth.seeded = true;
      truth.seed = 20260901;
      truth.tool_count = 1;
      name(truth.tools[0].tool, "Probe");
      truth.tools[0].T_image_tip = {{1, 0, 0, 0}, {true_x, 5.0, -3.0}};
      put(writer, exposed_ns, truth);
    }
  }
}

} // namespace bregma::test
