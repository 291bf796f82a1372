#include "tests/faults/faulty_client.hpp"

#include <cstring>

#include "algorithms/geometry/unknown.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"

namespace bregma::faults {
namespace {

constexpr std::int64_t kPeriod_ns = 50'000'000;
constexpr std::int64_t kFloodPeriod_ns = 5'000'000;
constexpr int kFloodCommands = 100; // per kFloodPeriod_ns: 20,000 per second

} // namespace

std::vector<wire::Command> FaultyClient::commands(std::int64_t now_ns, std::int64_t begin_ns, std::int64_t end_ns) {
  std::vector<wire::Command> out;
  if (begin_ns == 0 || now_ns < begin_ns || now_ns >= end_ns || now_ns < next_ns_) {
    return out;
  }
  next_ns_ = now_ns + (fault_ == ClientFault::kFloods ? kFloodPeriod_ns : kPeriod_ns);
  switch (fault_) {
  case ClientFault::kMalformed:
    ask_malformed(out, now_ns);
    break;
  case ClientFault::kUnknownNames:
    ask_unknown_names(out, now_ns);
    break;
  case ClientFault::kOtherKind:
    ask_same_id(out, now_ns);
    break;
  case ClientFault::kFloods:
    for (int i = 0; i < kFloodCommands; ++i) {
      ask(out, command(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, {"none", ""}, now_ns), now_ns);
    }
    break;
  default:
    break;
  }
  return out;
}

wire::Command FaultyClient::command(wire::CommandKind kind, std::initializer_list<std::string_view> values,
                                    std::int64_t now_ns) {
  wire::Command out{};
  (void)wire::set_name(out.client, kName);
  out.id = ++last_id_;
  out.sent_time_ns = now_ns;
  (void)wire::fill_command(out, kind, values);
  return out;
}

void FaultyClient::ask(std::vector<wire::Command> &out, const wire::Command &command, std::int64_t now_ns) {
  asked_.push_back({command.id, command.kind, now_ns});
  out.push_back(command);
}

void FaultyClient::ask_malformed(std::vector<wire::Command> &out, std::int64_t now_ns) {
  wire::Command wrong_form = command(bregma_wire_COMMAND_CLOSE_CASE, {}, now_ns);
  wrong_form.body._d = bregma_wire_FORM_FOLDER;
  ask(out, wrong_form, now_ns);
  wire::Command no_end = command(bregma_wire_COMMAND_START_PIVOT, {"Stylus"}, now_ns);
  std::memset(no_end.body._u.tool.tool, 'x', sizeof no_end.body._u.tool.tool);
  ask(out, no_end, now_ns);
  wire::Command unknown = command(bregma_wire_COMMAND_CLOSE_CASE, {}, now_ns);
  unknown.kind = 9999;
  ask(out, unknown, now_ns);
  wire::Command not_finite = command(bregma_wire_COMMAND_MOVE_TO_TRAJECTORY, {"Robot", "Biopsy", "10", "5"}, now_ns);
  not_finite.body._u.motion.speed_mm_s = geometry::kUnknown;
  ask(out, not_finite, now_ns);
  wire::Command nobody = command(bregma_wire_COMMAND_CLOSE_CASE, {}, now_ns);
  std::memset(nobody.client, 'x', sizeof nobody.client); // there is no client to answer
  out.push_back(nobody);
}

void FaultyClient::ask_unknown_names(std::vector<wire::Command> &out, std::int64_t now_ns) {
  ask(out, command(bregma_wire_COMMAND_LOAD_CASE, {"/nowhere"}, now_ns), now_ns);
  ask(out, command(bregma_wire_COMMAND_START_PIVOT, {"Nobody"}, now_ns), now_ns);
  ask(out, command(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, {"Nobody", "F1"}, now_ns), now_ns);
  ask(out, command(bregma_wire_COMMAND_CHECK_TOUCH, {"Probe", "Nowhere"}, now_ns), now_ns);
  ask(out, command(bregma_wire_COMMAND_START_NAVIGATION, {"Reference", "Nowhere"}, now_ns), now_ns);
}

void FaultyClient::ask_same_id(std::vector<wire::Command> &out, std::int64_t now_ns) {
  const wire::Command first = command(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, {"none", ""}, now_ns);
  ask(out, first, now_ns);
  --last_id_;
  ask(out, command(bregma_wire_COMMAND_REMOVE_FIDUCIAL, {"Nowhere"}, now_ns), now_ns);
}

} // namespace bregma::faults
