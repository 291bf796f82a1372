#include "idl/commands.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <iterator>

#include "idl/names.hpp"

namespace bregma::wire {
namespace {

using Type = CommandField::Type;

#define BREGMA_FIELD(member) offsetof(CommandBody, _u.member)
constexpr CommandField kFolder[] = {{"case folder", Type::kPath, BREGMA_FIELD(folder.folder)}};
constexpr CommandField kTool[] = {{"tool", Type::kName, BREGMA_FIELD(tool.tool)}};
constexpr CommandField kTouch[] = {{"tool", Type::kName, BREGMA_FIELD(touch.tool)},
                                   {"point", Type::kName, BREGMA_FIELD(touch.point)}};
constexpr CommandField kPoint[] = {{"point", Type::kName, BREGMA_FIELD(point.point)}};
constexpr CommandField kPlan[] = {{"tool", Type::kName, BREGMA_FIELD(plan.tool)},
                                  {"trajectory", Type::kName, BREGMA_FIELD(plan.trajectory), true}};
constexpr CommandField kAlarm[] = {{"alarm", Type::kName, BREGMA_FIELD(alarm.kind)},
                                   {"subject", Type::kName, BREGMA_FIELD(alarm.subject), true}};
constexpr CommandField kDevice[] = {{"device", Type::kName, BREGMA_FIELD(device.device)}};
constexpr CommandField kStep[] = {{"device", Type::kName, BREGMA_FIELD(step.device)},
                                  {"step", Type::kName, BREGMA_FIELD(step.step)}};
constexpr CommandField kSeries[] = {{"device", Type::kName, BREGMA_FIELD(series.device)},
                                    {"protocol", Type::kName, BREGMA_FIELD(series.protocol)},
                                    {"slices", Type::kCount, BREGMA_FIELD(series.slices), true}};
constexpr CommandField kCoils[] = {{"device", Type::kName, BREGMA_FIELD(coils.device)},
                                   {"pattern", Type::kName, BREGMA_FIELD(coils.pattern)},
                                   {"current_mA", Type::kNumber, BREGMA_FIELD(coils.current_mA)},
                                   {"hold_s", Type::kNumber, BREGMA_FIELD(coils.hold_s)}};
constexpr CommandField kScan[] = {{"device", Type::kName, BREGMA_FIELD(scan.device)},
                                  {"sensor", Type::kName, BREGMA_FIELD(scan.sensor)},
                                  {"speed_mm_s", Type::kNumber, BREGMA_FIELD(scan.speed_mm_s)},
                                  {"spacing_mm", Type::kNumber, BREGMA_FIELD(scan.spacing_mm)}};
constexpr CommandField kMotion[] = {{"device", Type::kName, BREGMA_FIELD(motion.device)},
                                    {"trajectory", Type::kName, BREGMA_FIELD(motion.trajectory)},
                                    {"standoff_mm", Type::kNumber, BREGMA_FIELD(motion.standoff_mm)},
                                    {"speed_mm_s", Type::kNumber, BREGMA_FIELD(motion.speed_mm_s)}};
#undef BREGMA_FIELD

constexpr std::array<std::span<const CommandField>, 14> kForms{
    {{}, {}, kFolder, kTool, kTouch, kPoint, kPlan, kAlarm, kDevice, kStep, kSeries, kCoils, kScan, kMotion}};
static_assert(kForms.size() == bregma_wire_FORM_MOTION + 1);

// The body's memory at a field. The union of the C compiler has standard layout.
char *at(CommandBody &body, const CommandField &field) noexcept {
  return reinterpret_cast<char *>(&body) + field.offset;
}
const char *at(const CommandBody &body, const CommandField &field) noexcept {
  return reinterpret_cast<const char *>(&body) + field.offset;
}

std::size_t capacity(const CommandField &field) noexcept {
  return field.type == Type::kPath ? sizeof(CommandBody{}._u.folder.folder) : sizeof(Name);
}

template <class Number> std::string set_number(char *to, const CommandField &field, std::string_view text) {
  Number value{};
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (code != std::errc() || end != text.data() + text.size()) {
    return std::string(field.label) + " '" + std::string(text) + "' is not a number";
  }
  std::memcpy(to, &value, sizeof value);
  return {};
}

std::string set_field(CommandBody &body, const CommandField &field, std::string_view text) {
  if (text.empty()) {
    return field.may_be_empty ? std::string() : std::string(field.label) + " is empty";
  }
  if (field.type == Type::kNumber) {
    return set_number<double>(at(body, field), field, text);
  }
  if (field.type == Type::kCount) {
    return set_number<std::uint32_t>(at(body, field), field, text);
  }
  const std::size_t limit = capacity(field) - 1;
  if (text.size() > limit) {
    return std::string(field.label) + " '" + std::string(text) + "' is too long: " + std::to_string(text.size()) +
           " bytes, at most " + std::to_string(limit);
  }
  text.copy(at(body, field), limit);
  return {};
}

} // namespace

std::span<const CommandField> fields_of(CommandForm form) noexcept {
  const bool known = form >= 0 && static_cast<std::size_t>(form) < kForms.size();
  return known ? kForms[static_cast<std::size_t>(form)] : std::span<const CommandField>();
}

std::string command_name(CommandKind kind) {
  const CommandEntry *entry = find_command(kind);
  return entry != nullptr ? entry->name : "command " + std::to_string(kind);
}

std::string_view text_of(const CommandBody &body, const CommandField &field) noexcept {
  const char *from = at(body, field);
  return {from, strnlen(from, capacity(field))};
}

std::string fill_command(Command &out, CommandKind kind, std::span<const std::string_view> values) {
  const CommandEntry *entry = find_command(kind);
  if (entry == nullptr) {
    return command_name(kind) + " is not known";
  }
  const auto fields = fields_of(entry->form);
  if (values.size() > fields.size()) {
    return command_name(kind) + " takes " + std::to_string(fields.size()) + " values, not " +
           std::to_string(values.size());
  }
  out.kind = kind;
  out.body = {};
  out.body._d = entry->form;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const std::string_view value = i < values.size() ? values[i] : std::string_view();
    if (std::string wrong = set_field(out.body, fields[i], value); !wrong.empty()) {
      return wrong;
    }
  }
  return {};
}

std::string malformed(const Command &command) {
  const CommandEntry *entry = find_command(command.kind);
  if (entry == nullptr) {
    return command_name(command.kind) + " is not known";
  }
  if (command.body._d != entry->form) {
    return std::string(entry->name) + " has a body of form " + std::to_string(command.body._d) + ", not " +
           std::to_string(entry->form);
  }
  for (const CommandField &field : fields_of(entry->form)) {
    double number = 0.0;
    if (field.type == Type::kNumber) {
      std::memcpy(&number, at(command.body, field), sizeof number);
    }
    if (!std::isfinite(number)) {
      return std::string(field.label) + " is not a finite number";
    }
    const bool is_text = field.type == Type::kName || field.type == Type::kPath;
    if (is_text && text_of(command.body, field).size() == capacity(field)) {
      return std::string(field.label) + " is too long for a name";
    }
  }
  return {};
}

CommandReply reply_to(const Command &command, CommandResult result, std::string_view text, SessionState session) {
  CommandReply out{};
  std::copy(std::begin(command.client), std::end(command.client), std::begin(out.client));
  out.id = command.id;
  out.kind = command.kind;
  out.result = result;
  out.session = session;
  out.value_mm = kUnknown;
  set_text(out.text, text);
  return out;
}

} // namespace bregma::wire
