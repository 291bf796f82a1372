// Arbitrary bytes as samples of the five streams: nothing crashes, every sample is accepted or rejected, and accepted
// samples satisfy the guarantees of the input check.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <numeric>
#include <string>
#include <vector>

#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "server/inputs/input_guard.hpp"
#include "tests/fuzz/fuzzer_bytes.hpp"

namespace {

using namespace bregma;

constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;

using fuzz::Bytes;
using fuzz::require;

void require_rotation(const wire::Pose &pose) {
  double squares = 0.0;
  for (const double q : pose.rotation_wxyz) {
    squares += q * q;
  }
  require(std::abs(std::sqrt(squares) - 1.0) < 2.0 * inputs::kRotationTolerance);
  for (const double t : pose.translation_mm) {
    require(std::abs(t) <= inputs::kMaxPosition_mm);
  }
}

// A covariance that is stated is finite, with variances that are not negative.
void require_covariance(const wire::PoseCovariance &upper) {
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t column = row; column < 6; ++column) {
      const float entry = upper[wire::upper_index(row, column)];
      require(std::isfinite(entry) && (row != column || entry >= 0.0F));
    }
  }
}

void require_usable(const wire::TrackerFrame &frame) {
  require(frame.tool_count <= bregma_wire_MAX_TOOLS);
  for (std::uint32_t i = 0; i < frame.tool_count; ++i) {
    require(wire::is_terminated(frame.tools[i].tool));
    require(frame.tools[i].status >= 0);
    if (frame.tools[i].status == bregma_wire_TOOL_VISIBLE || frame.tools[i].status == bregma_wire_TOOL_PARTLY_VISIBLE) {
      require_rotation(frame.tools[i].T_tracker_tool);
      require_covariance(frame.tools[i].covariance);
    }
  }
}
void require_usable(const wire::RobotState &state) {
  require(state.mode >= 0 && wire::is_terminated(state.tool) && wire::is_terminated(state.motion_client));
  require_rotation(state.T_base_flange);
  require_covariance(state.covariance);
}
void require_usable(const wire::RobotMotionState &state) {
  require(state.operating_state >= 0 && state.phase >= 0 && state.cause >= 0);
  require(wire::is_terminated(state.motion_client) && strnlen(state.text, sizeof state.text) < sizeof state.text);
  require(state.joint_count <= bregma_wire_MAX_JOINTS && state.waypoint <= state.waypoint_count);
  for (std::uint32_t i = 0; i < state.joint_count; ++i) {
    require(std::isfinite(state.setpoint_jp_rad[i]));
  }
}
void require_usable(const wire::RangeSample &sample) {
  require(sample.status > bregma_wire_RANGE_UNKNOWN);
  require(sample.status != bregma_wire_RANGE_VALID || (sample.range_mm >= 0.0 && sample.sigma_mm >= 0.0));
}
void require_usable(const wire::ForceSample &sample) {
  for (const double force : sample.force_N) {
    require(std::isfinite(force));
  }
}

template <class Sample> void run(Bytes bytes) {
  inputs::InputGuard<Sample> guard(std::vector<std::string>{"D"}, {});
  std::int64_t now_ns = kStart_ns;
  std::int64_t last_ns = 0;
  std::uint64_t sent = 0;
  while (!bytes.empty()) {
    // The first byte selects the fields that are made plausible, so that the fuzzer passes the first rule.
    const auto plan = bytes.take<std::uint8_t>();
    now_ns += bytes.take<std::uint16_t>() * std::int64_t{1'000};
    auto sample = bytes.take<Sample>();
    if ((plan & 1U) != 0) {
      static_cast<void>(wire::set_name(sample.device, "D"));
    }
    if ((plan & 2U) != 0) {
      sample.device_time_ns = now_ns + sample.device_time_ns % 100'000'000;
      sample.sent_time_ns = now_ns;
      sample.period_ns = 4'000'000;
    }
    if ((plan & 4U) != 0) {
      sample.frame = sent;
    }
    const auto verdict = guard.check(sample, plan >> 6U, now_ns);
    ++sent;
    if (verdict.accepted) {
      require_usable(sample);
      require(verdict.acquired_time_ns > last_ns);
      last_ns = verdict.acquired_time_ns;
    }
  }
  const auto health = guard.health(now_ns);
  const auto &rejected = health.devices[0].rejected;
  require(health.devices[0].taken + std::accumulate(std::begin(rejected), std::end(rejected), std::uint64_t{0}) +
              health.unknown_device_samples ==
          sent);
}

// What passes the check of a command has the body of its kind, names with an end and finite numbers.
void run_command(Bytes bytes) {
  const auto plan = bytes.take<std::uint8_t>();
  auto command = bytes.take<wire::Command>();
  const wire::CommandEntry *entry = wire::find_command(plan % (bregma_wire_COMMAND_RESET_SCANNER_REGISTRATION + 2));
  if (entry != nullptr) {
    command.kind = entry->kind;
    command.body._d = entry->form;
  }
  if (!wire::malformed(command).empty()) {
    return;
  }
  for (const wire::CommandField &field : wire::fields_of(command.body._d)) {
    const std::string_view text = wire::text_of(command.body, field);
    require(field.type != wire::CommandField::Type::kName || text.size() <= wire::kNameLength);
  }
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  if (size == 0) {
    return 0;
  }
  const Bytes rest(data + 1, size - 1);
  switch (data[0] % 6) {
  case 0:
    run<wire::TrackerFrame>(rest);
    break;
  case 1:
    run<wire::RobotState>(rest);
    break;
  case 2:
    run<wire::RangeSample>(rest);
    break;
  case 4:
    run<wire::RobotMotionState>(rest);
    break;
  case 3:
    run_command(rest);
    break;
  default:
    run<wire::ForceSample>(rest);
    break;
  }
  return 0;
}
