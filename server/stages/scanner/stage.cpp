#include "server/stages/scanner/stage.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <filesystem>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

#include "casefile/coil_frames.hpp"
#include "casefile/markups.hpp"
#include "idl/commands.hpp"
#include "server/stages/schedules.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

constexpr std::int64_t kStateRepeat_ns = 1'000'000'000;
constexpr std::int64_t kRefusalShown_ns = 10'000'000'000;
constexpr int kCorrectedPerStep = 4;

constexpr AlarmConditions::Kind kSlicesRefused{alarm::kSlicesRefused, bregma_wire_SEVERITY_WARNING,
                                               SessionEffect::kNone, 0, 0};
constexpr AlarmConditions::Kind kScannerMoved{alarm::kScannerMoved, bregma_wire_SEVERITY_CRITICAL, SessionEffect::kNone,
                                              0, 0};
constexpr AlarmConditions::Kind kCoilsOn{alarm::kCoilsOn, bregma_wire_SEVERITY_CRITICAL, SessionEffect::kNone, 0, 0};

[[noreturn]] void refuse(const std::string &key, const std::string &text) {
  throw std::invalid_argument(key + ": " + text);
}

ProcedureOptions options_of(const ScannerParameters &p) {
  ProcedureOptions out;
  out.scanner = p.device;
  out.coils = p.coils;
  if (!p.frame.empty()) {
    auto frame = casefile::read_coil_frame(p.frame);
    if (!frame) {
      refuse("scanner.frame", frame.error().message);
    }
    for (const auto &[key, pattern] : {std::pair("scanner.top", p.top), std::pair("scanner.bottom", p.bottom),
                                       std::pair("scanner.verify", p.verify)}) {
      const auto coils = coils_of_pattern(*frame, pattern.empty() ? "background" : pattern);
      if (!coils || (coils->empty() && !pattern.empty())) {
        refuse(std::string(key) + " = \"" + pattern + "\"", coils ? "no coil carries current" : coils.error().message);
      }
    }
    if (frame->coils.size() > bregma_wire_MAX_COILS) {
      refuse("scanner.frame", p.frame + ": more than " + std::to_string(bregma_wire_MAX_COILS) + " coils");
    }
    out.frame = std::move(*frame);
  }
  if (!p.phantom.empty()) {
    const auto points = casefile::read_points(p.phantom);
    if (!points) {
      refuse("scanner.phantom", points.error().message);
    }
    out.phantom_mm.resize(3, static_cast<Eigen::Index>(points->size()));
    for (std::size_t i = 0; i < points->size(); ++i) {
      out.phantom_mm.col(static_cast<Eigen::Index>(i)) = (*points)[i].position_mm;
    }
  }
  out.cell_mm = p.cell_mm;
  out.bar_mm = p.bar_mm;
  out.max_phantom_moved_mm = p.phantom_moved_mm;
  out.field_file = p.field;
  out.field_days = static_cast<int>(p.field_days);
  out.top = p.top;
  out.bottom = p.bottom;
  out.verify = p.verify;
  out.verify_protocol = p.verify_protocol;
  out.opposed_read_outs = p.opposed_read_outs;
  out.current_mA = p.current_mA;
  out.hold_s = p.hold_s;
  out.limit_mm = p.limit_mm;
  out.target_mm = {p.target_x_mm, p.target_y_mm, p.target_z_mm};
  out.series_timeout_ns = ns_of_ms(1e3 * p.series_timeout_s);
  return out;
}

wire::Command command_for(const DeviceOrder &order, std::int64_t now_ns) {
  wire::Command out{};
  const std::vector<std::string_view> values(order.values.begin(), order.values.end());
  (void)wire::fill_command(out, order.kind, values); // names were checked with the parameters
  (void)wire::set_name(out.client, ScannerStage::kClient);
  (void)wire::set_name(out.receiver, order.device);
  out.id = order.id;
  out.sent_time_ns = now_ns;
  return out;
}

} // namespace

void declare(base::ParameterSet &set, ScannerParameters &p) {
  set.string("devices.scanner", &p.device, "Name of the MR scanner.");
  set.string("devices.coils", &p.coils, "Name of the coil controller of the registration frame.");
  set.string("scanner.frame", &p.frame, "File of the registration frame (TOML); empty: no registration.");
  set.string("scanner.phantom", &p.phantom,
             "Control points of the grid phantom in CT (.mrk.json); empty: the field cannot be measured.");
  set.string("scanner.field", &p.field,
             "Distortion field of the scanner (.nrrd): read at the start, and written when it is measured.");
  set.number("scanner.cell_mm", &p.cell_mm, "mm", 2, 200, "Distance of neighbouring bars of the phantom.");
  set.number("scanner.bar_mm", &p.bar_mm, "mm", 0.2, 50, "Width of the phantom's bars.");
  set.integer("scanner.field_days", &p.field_days, "days", 0, 3650,
              "Days until a measured field expires; 0: never. An expired field is not used.");
  set.number("scanner.phantom_moved_mm", &p.phantom_moved_mm, "mm", 0.01, 10,
             "A field is refused if the phantom moved by more between its scans.");
  set.string("scanner.top", &p.top, "Groups or coils that register, in the upper scan, joined by +.");
  set.string("scanner.bottom", &p.bottom, "The same in the lower scan.");
  set.string("scanner.verify", &p.verify, "Groups or coils that verify; empty: none.");
  set.string("scanner.verify_protocol", &p.verify_protocol, "Protocol of the scan that verifies.");
  set.flag("scanner.opposed_read_outs", &p.opposed_read_outs,
           "Phantom and coils are scanned once more with the read-out reversed, by protocols with the suffix "
           "-reversed: what B0 does to them cancels.");
  set.number("scanner.current_mA", &p.current_mA, "mA", 1, 1000, "Current of a coil.");
  set.number("scanner.hold_s", &p.hold_s, "s", 1, 3600, "The coil controller switches off by itself after this time.");
  set.number("scanner.limit_mm", &p.limit_mm, "mm", 0.01, 100,
             "Limit of the predicted 95 % error at the target, and of the error of the coils that verify.");
  set.number("scanner.target_x_mm", &p.target_x_mm, "mm", -1000, 1000, "The target in the robot's base.");
  set.number("scanner.target_y_mm", &p.target_y_mm, "mm", -1000, 1000, "The target in the robot's base.");
  set.number("scanner.target_z_mm", &p.target_z_mm, "mm", -1000, 1000, "The target in the robot's base.");
  set.number("scanner.series_timeout_s", &p.series_timeout_s, "s", 0.1, 7200,
             "A series of which no slice comes for this time has failed.");
  set.flag("scanner.brightness", &p.brightness, "Corrected slices have the brightness corrected as well.");
}

ScannerStage::ScannerStage(const ScannerParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kWorker, .rate_hz = kLookRate_hz, .triggered = true, .long_work = true}),
      device_(parameters.device), host_(context.host), slices_(context.link), replies_(context.link),
      drivers_(context.link), commands_(context.link), states_(context.link), corrected_(context.link), guard_([&] {
        wire::Name name{};
        if (parameters.device.empty() || !wire::set_name(name, parameters.device)) {
          refuse("devices.scanner = \"" + parameters.device + "\"", "is no name of a device");
        }
        return SliceGuard(name);
      }()),
      procedure_(options_of(parameters),
                 [this](const std::function<void()> &job) { host_.run_elsewhere(Work::kScanner, job); }),
      corrector_(parameters.brightness), alarms_(conditions) {
  std::error_code missing;
  if (!parameters.field.empty() && std::filesystem::exists(parameters.field, missing)) {
    auto field = load_field(parameters.field);
    if (!field) {
      refuse("scanner.field", field.error().message);
    }
    if (!field->scanner.empty() && field->scanner != parameters.device) {
      refuse("scanner.field",
             parameters.field + ": is of the scanner \"" + field->scanner + "\", not of \"" + parameters.device + "\"");
    }
    procedure_.use_field(std::move(*field));
  }
}

ScannerStage::~ScannerStage() {
  if (procedure_.coils_may_be_on()) {
    procedure_.switch_off();
    const std::int64_t now_ns = last_ns_;
    procedure_.poll(now_ns);
    for (const DeviceOrder &order : procedure_.take_orders()) {
      commands_(command_for(order, now_ns), now_ns);
    }
  }
}

void ScannerStage::connect(ScannerInbox &commands, const runtime::LatestValue<RobotToolsView> &tools) {
  inbox_ = &commands;
  tools_.connect(tools);
}

void ScannerStage::step(const Moment &now) noexcept {
  try {
    advance(now);
  } catch (const std::exception &error) { // no memory for a stack
    host_.log(LogLevel::kError, std::string("scanner: ") + error.what());
  }
}

void ScannerStage::advance(const Moment &now) {
  last_ns_ = now.utc_ns;
  procedure_.set_wall_lead(now.wall_lead_ns());
  (void)tools_.refresh();
  take_commands(now);
  drivers_.take_each(now.utc_ns, [&](const wire::DriverHealth &health, std::uint64_t /*writer*/) {
    procedure_.on_driver(health, now.utc_ns);
    return false; // not recorded: the state says what follows from it
  });
  take_slices(now);
  replies_.take_each(now.utc_ns, [&](const wire::CommandReply &reply, std::uint64_t /*writer*/) {
    const bool own = wire::view(reply.client) == kClient;
    if (own) {
      procedure_.on_reply(reply, now.utc_ns);
    }
    return own; // the replies of others are recorded by those who answer or ask
  });
  procedure_.poll(now.utc_ns);
  send_orders(now);
  correct(now);
  watch(now);
  publish(now);
}

void ScannerStage::take_commands(const Moment &now) {
  inbox_->take_each([&](const wire::Command &command) {
    ProcedureAnswer answer;
    const auto &body = command.body._u;
    switch (command.kind) {
    case bregma_wire_COMMAND_START_SCANNER_REGISTRATION:
      answer = procedure_.start(wire::text(body.device.device), now.utc_ns);
      break;
    case bregma_wire_COMMAND_CONFIRM_SCANNER_STEP:
      answer = procedure_.confirm(wire::text(body.step.device), wire::text(body.step.step), now.utc_ns);
      break;
    case bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION:
      answer = procedure_.accept(wire::text(body.device.device), now.utc_ns);
      break;
    default:
      answer = procedure_.reset(wire::text(body.device.device), now.utc_ns);
      break;
    }
    StageAnswer out{};
    copy_name(out.client, command.client);
    out.id = command.id;
    out.sent_time_ns = command.sent_time_ns;
    out.kind = command.kind;
    out.result = answer.done ? bregma_wire_COMMAND_DONE : bregma_wire_COMMAND_REFUSED;
    wire::set_text(out.text, answer.text);
    answered_.push_back(out);
  });
}

void ScannerStage::take_slices(const Moment &now) {
  const std::size_t taken = slices_.take_each(now.utc_ns, [&](const wire::ImageSlice &slice, std::uint64_t writer) {
    const SliceVerdict verdict = guard_.check(slice, writer, now.utc_ns);
    if (!verdict.accepted && verdict.reason == bregma_wire_REJECT_UNKNOWN_DEVICE) {
      return false; // of another scanner: counted, and no fault of this one
    }
    if (!verdict.accepted) {
      refused(slice, verdict.text, now);
      procedure_.on_refused(slice, verdict.text, now.utc_ns);
      return false;
    }
    if (verdict.other_writer) {
      procedure_.on_other_scanner();
    }
    if (procedure_.on_slice(slice, now.utc_ns)) {
      return true;
    }
    if (waiting_.size() >= kMaxWaiting) { // a display wants the newest
      refused(waiting_.front().header, "slices come faster than they are corrected: it is skipped", now);
      ++not_corrected_;
      waiting_.pop_front();
    }
    waiting_.emplace_back(slice);
    return true;
  });
  if (taken == 0) {
    const std::uint32_t alive = slices_.writers_alive();
    guard_.set_writers_alive(alive);
    procedure_.on_writers(alive, now.utc_ns);
  }
}

void ScannerStage::refused(const wire::ImageSlice &slice, const std::string &text, const Moment &now) {
  refused_text_ = "series " + std::to_string(slice.series) + ", slice " + std::to_string(slice.index) + ": " + text;
  refused_ns_ = now.utc_ns;
}

void ScannerStage::send_orders(const Moment &now) {
  for (const DeviceOrder &order : procedure_.take_orders()) {
    commands_(command_for(order, now.utc_ns), now.utc_ns);
  }
}

void ScannerStage::correct(const Moment &now) {
  for (int i = 0; i < kCorrectedPerStep && !waiting_.empty(); ++i) {
    const OwnedSlice slice = std::move(waiting_.front());
    waiting_.pop_front();
    if (!procedure_.field_is_valid(now.utc_ns)) {
      continue; // as the state says
    }
    const ScannerField &field = *procedure_.field();
    auto corrected = corrector_.correct(slice, field);
    if (!corrected) {
      refused(slice.header, corrected.error().message, now);
      ++not_corrected_;
      continue;
    }
    // The earlier ones first: the topic keeps what was written last, and that is to be the newest slice.
    while (auto again = corrector_.correct_again()) {
      publish_corrected(std::move(*again), field, now);
    }
    publish_corrected(std::move(*corrected), field, now);
  }
}

void ScannerStage::publish_corrected(CorrectedPixels pixels, const ScannerField &field, const Moment &now) {
  pixels_ = std::move(pixels);
  wire::CorrectedSlice out{};
  copy_name(out.device, pixels_.header.device);
  out.published_time_ns = now.utc_ns;
  (void)wire::set_name(out.field, std::string_view(field.identity).substr(0, wire::kNameLength));
  out.max_shift_mm = pixels_.summary.max_shift_mm;
  out.extrapolated_fraction = pixels_.summary.extrapolated_fraction;
  out.error_95_mm = pixels_.summary.error_95_mm;
  out.missing_fraction = pixels_.missing_fraction;
  out.slice = pixels_.header;
  out.slice.correction = pixels_.correction;
  out.slice.pixels._buffer = pixels_.pixels.data();
  out.slice.pixels._length = out.slice.pixels._maximum = static_cast<std::uint32_t>(pixels_.pixels.size());
  out.brightness_corrected = corrector_.corrects_brightness();
  put_tip(out, now.utc_ns);
  corrected_(out, now.utc_ns);
  ++slices_corrected_;
}

// The tip where it is now, in the plane of the slice.
void ScannerStage::put_tip(wire::CorrectedSlice &out, std::int64_t now_ns) const {
  out.tip_status = bregma_wire_POSE_LOST;
  put_unknown(out.tip_pixel);
  put_unknown(out.tip_direction);
  out.tip_distance_mm = out.tip_error_95_mm = wire::kUnknown;
  const RobotToolsView &tools = tools_.value();
  const bool registered = procedure_.validity() == bregma_wire_SCANNER_VALID;
  for (std::uint32_t i = 0; i < tools.count; ++i) {
    const wire::RobotTool &tool = tools.tools[i];
    const bool live = tool.scanner_status == bregma_wire_POSE_LIVE;
    const bool in_time = now_ns - tool.published_time_ns <= tool.valid_for_ns;
    copy_name(out.tip_tool, tool.tool);
    out.tip_status = live && !in_time ? bregma_wire_POSE_STALE : tool.scanner_status;
    if (live && in_time && !registered) { // void since that pose was made, perhaps by this very slice
      out.tip_status = bregma_wire_POSE_NOT_REGISTERED;
    }
    if (out.tip_status != bregma_wire_POSE_LIVE) {
      continue;
    }
    struct Plane;
    using mri::frame::Device;
    const auto T_device_slice = wire::from_wire<Device, Plane>(out.slice.T_scanner_slice);
    const auto T_slice_tip = T_device_slice.inverse() * wire::from_wire<Device, frame::Tip>(tool.T_scanner_tip);
    const Vector3d &tip = T_slice_tip.translation();
    out.tip_pixel[0] = tip.x() / out.slice.spacing_mm[0];
    out.tip_pixel[1] = tip.y() / out.slice.spacing_mm[1];
    out.tip_distance_mm = tip.z();
    put(Vector3d(T_slice_tip.rotation() * Vector3d::UnitZ()), out.tip_direction);
    out.tip_error_95_mm = tool.scanner_error_95_mm;
    return;
  }
}

void ScannerStage::watch(const Moment &now) {
  const bool refused = refused_ns_ != 0 && now.utc_ns - refused_ns_ < kRefusalShown_ns;
  alarms_.update(kSlicesRefused, device_, refused, "slices are refused: " + refused_text_, now.utc_ns);
  const wire::ScannerValidity validity = procedure_.validity();
  alarms_.update(kScannerMoved, device_, validity > bregma_wire_SCANNER_VALID,
                 "the registration of the scanner is void: " + procedure_.validity_text(), now.utc_ns);
  alarms_.update(kCoilsOn, device_, !procedure_.coils_fault().empty(), procedure_.coils_fault(), now.utc_ns);
}

void ScannerStage::publish(const Moment &now) {
  pose.store(procedure_.pose());
  if (now.tick) {
    devices.store(guard_.health(now.utc_ns));
  }
  const bool changed = published_revision_ != procedure_.revision() || slices_refused() != seen_refused_ ||
                       slices_corrected_ != seen_corrected_;
  if (!(changed && now.tick) && answered_.empty() && now.monotonic_ns - published_ns_ < kStateRepeat_ns) {
    return;
  }
  published_revision_ = procedure_.revision();
  seen_refused_ = slices_refused();
  seen_corrected_ = slices_corrected_;
  published_ns_ = now.monotonic_ns;
  wire::ScannerRegistration state{};
  (void)wire::set_name(state.device, device_); // its length was checked at the start
  state.time_ns = now.utc_ns;
  procedure_.fill(state, now.utc_ns);
  state.slices_taken = guard_.taken();
  state.slices_refused = slices_refused();
  state.slices_corrected = slices_corrected_;
  wire::set_text(state.refused_text, refused_text_);
  states_(state, now.utc_ns);
  // After the state: a client that has its answer finds no older one.
  for (const StageAnswer &answer : answered_) {
    (void)answers.try_push(answer); // a full ring: the session answers by its time-out
  }
  answered_.clear();
}

} // namespace bregma::server
