#include "drivers/sim/scanner/scanner_on_the_wire.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string_view>

#include "base/text.hpp"
#include "drivers/sim/scanner/dicom_slice.hpp"
#include "idl/commands.hpp"

namespace bregma::sim::scanner {

namespace {

constexpr std::size_t kMaxWaiting = 16;
constexpr std::string_view kReversed = "-reversed"; // of the read-out; every protocol has both

// What enters the bore, between the coils.
const Vector3d kBall_mm(20.0, 35.0, -30.0);
constexpr double kBallRadius_mm = 45.0;

struct Acquired {
  const char *name;
  Plane plane;
  double centre_mm; // of the stack, upwards
  int slices;
  bool phantom;
};
constexpr Acquired kProtocols[] = {
    {"scout", Plane::kCoronal, 0.0, 5, false},
    {"phantom", Plane::kCoronal, 3.5, 200, true},
    {"top", Plane::kCoronal, 55.0, 60, false},
    {"bottom", Plane::kCoronal, -55.0, 60, false},
    {"tree-coronal", Plane::kCoronal, 5.0, 60, false},
    {"tree-sagittal", Plane::kSagittal, 0.0, 100, false},
    {"tree-transverse", Plane::kTransverse, 0.0, 120, false},
    {"tree-oblique", Plane::kDoubleOblique, 0.0, 120, false},
};

Protocol protocol_of(const Acquired &a, int slices) {
  if (a.phantom) {
    return phantom_protocol();
  }
  Protocol out = coil_protocol(slices);
  if (std::string_view(a.name) == "scout") { // coarse, for the position alone
    out.name = "scout";
    out.matrix = 96;
    out.thickness_mm = 10.0;
  }
  return out;
}

// Device to Patient for a patient on the back, head first; its own inverse.
Vector3d in_patient(const Vector3d &device) { return {device.x(), -device.y(), -device.z()}; }

} // namespace

void ScannerOnTheWire::declare(base::ParameterSet &parameters) {
  parameters.integer("seed", &seed_, "", 0, 1'000'000'000, "Decides the field and every hidden error")
      .number("slice_ms", &slice_ms_, "ms", 0.0, 60'000.0, "Time from one slice to the next")
      .number("table_mm", &table_mm_, "mm", -3000.0, 3000.0, "Position of the table that slices state")
      .string("folder", &folder_, "Folder for DICOM files; empty: none")
      .string("coils", &coils_device_, "Device whose commands switch the coils")
      .flag("plays_coils", &plays_coils_, "Also answer the commands to the coil controller")
      .flag("vendor", &vendor_, "Send images with the gradients corrected, as the scanner's vendor does")
      .number("snr", &options_.appearance.snr, "", 0.0, 1000.0, "Of water; 0: no noise")
      .number(
          "entered_ppm", &entered_ppm_, "ppm", 0.0, 10.0,
          "Susceptibility of a ball that enters the bore with the registration frame, after the phantom was scanned")
      .number("distortion_mm", &options_.field.mean_mm, "mm", 0.0, 5.0, "Mean distortion of the phantom");
}

base::Result<void> ScannerOnTheWire::prepare(const driver::Settings &settings) {
  device_ = settings.device;
  options_.field.max_mm = options_.field.mean_mm * 4.14 / 1.20; // the paper's proportion
  if (!folder_.empty()) {
    std::error_code failed;
    std::filesystem::create_directories(folder_, failed);
    if (failed) {
      return base::failure("folder = " + folder_ + ": " + failed.message());
    }
  }
  return {};
}

driver::Outcome<void> ScannerOnTheWire::connect(driver::Io & /*io*/) {
  if (scanner_ == nullptr) {
    scanner_ = std::make_unique<SimulatedScanner>(options_, static_cast<std::uint64_t>(seed_));
  }
  return {};
}

driver::Outcome<driver::Progress> ScannerOnTheWire::read(driver::Io &io) {
  take_commands(io);
  if (!current_ && !waiting_.empty()) {
    current_ = std::move(waiting_.front());
    waiting_.pop_front();
    Series *series = &*current_; // stays where it is until its last slice is sent
    work_ = std::async(std::launch::async, [this, series] {
      if (entered_ppm_ > 0.0 && !entered_ && !series->phantom && phantom_scanned_) {
        entered_ = true;
        scanner_->enter_ball(entered_ppm_, kBall_mm, kBallRadius_mm);
      }
      phantom_scanned_ = phantom_scanned_ || series->phantom;
      Stack stack = series->phantom ? scanner_->phantom(series->protocol, series->plan)
                    : series->on.empty()
                        ? scanner_->background(series->protocol, series->plan)
                        : scanner_->foreground(series->protocol, series->plan, series->on, series->polarity);
      return vendor_ ? vendor_corrected(stack, scanner_->field()) : stack;
    });
  }
  if (work_.valid() && work_.wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
    current_->stack = work_.get();
    current_->due_ns = io.now_ns();
  }
  send_due_slices(io);
  (void)io.wait_until(io.now_ns() + 2'000'000);
  return driver::Progress::kContinue;
}

void ScannerOnTheWire::take_commands(driver::Io &io) {
  io.take<wire::Command>([&](const wire::Command &command) {
    const std::string_view receiver = wire::view(command.receiver);
    if (receiver == coils_device_ && command.kind == bregma_wire_COMMAND_SET_COILS &&
        wire::malformed(command).empty()) {
      set_coils(command, io);
    }
    if (receiver != device_) {
      return;
    }
    if (command.kind != bregma_wire_COMMAND_ACQUIRE_SERIES) {
      reply(command, bregma_wire_COMMAND_UNSUPPORTED, "a scanner acquires series only", io);
    } else if (const std::string wrong = wire::malformed(command); !wrong.empty()) {
      reply(command, bregma_wire_COMMAND_MALFORMED, wrong, io);
    } else {
      acquire(command, io);
    }
  });
}

void ScannerOnTheWire::set_coils(const wire::Command &command, driver::Io &io) {
  const auto &body = command.body._u.coils;
  const std::string pattern = wire::text(body.pattern);
  std::vector<std::string> groups;
  if (pattern != "background") {
    for (const std::string_view group : base::cells(pattern, '+')) {
      groups.emplace_back(group);
    }
  }
  for (const std::string &group : groups) {
    const std::vector<CoilDesign> &design = scanner_->design();
    if (std::none_of(design.begin(), design.end(), [&](const CoilDesign &c) { return c.group == group; })) {
      if (plays_coils_) {
        reply(command, bregma_wire_COMMAND_REFUSED, "\"" + group + "\" is no group of the frame", io);
      }
      return;
    }
  }
  groups_on_ = groups;
  current_mA_ = groups.empty() ? 0.0 : body.current_mA;
  off_ns_ = io.now_ns() + std::llround(1e9 * std::clamp(body.hold_s, 0.0, 3600.0)); // as the controller does
  if (plays_coils_) {
    reply(command, bregma_wire_COMMAND_DONE, groups.empty() ? "all coils off" : pattern + " on", io);
  }
}

void ScannerOnTheWire::acquire(const wire::Command &command, driver::Io &io) {
  const auto &body = command.body._u.series;
  const std::string name = wire::text(body.protocol);
  const bool reversed = name.ends_with(kReversed);
  const std::string_view plain = std::string_view(name).substr(0, name.size() - (reversed ? kReversed.size() : 0));
  const auto *known =
      std::find_if(std::begin(kProtocols), std::end(kProtocols), [&](const Acquired &a) { return plain == a.name; });
  if (known == std::end(kProtocols)) {
    return reply(command, bregma_wire_COMMAND_REFUSED, "protocol \"" + name + "\" is not known to this scanner", io);
  }
  if (body.slices > 400 || waiting_.size() >= kMaxWaiting) {
    return reply(command, bregma_wire_COMMAND_REFUSED,
                 body.slices > 400 ? "slices: at most 400" : "too many series wait", io);
  }
  Series series;
  series.command = command;
  series.name = name;
  const int slices = body.slices > 0 ? static_cast<int>(body.slices) : known->slices;
  series.protocol = protocol_of(*known, slices);
  series.plan = plan_of(known->plane, Vector3d(0, known->centre_mm, 0), slices);
  series.plan.read_reversed = reversed;
  series.phantom = known->phantom;
  if (!known->phantom && std::abs(current_mA_) > 0.0 && io.now_ns() < off_ns_) {
    series.on = groups_on_;
    series.polarity = current_mA_ > 0.0 ? 1 : -1;
    series.current_mA = current_mA_;
    for (std::size_t i = 0; i < scanner_->design().size(); ++i) {
      if (std::find(groups_on_.begin(), groups_on_.end(), scanner_->design()[i].group) != groups_on_.end()) {
        series.coils |= std::uint64_t{1} << i;
      }
    }
  }
  series.number = ++series_;
  // Identifiers under 2.25 hold one number of at most 39 digits.
  series.study_uid = "2.25.7" + std::to_string(seed_) + std::to_string(io.now_ns() / 1'000'000'000);
  series.series_uid = series.study_uid + "." + std::to_string(series.number);
  waiting_.push_back(std::move(series));
}

void ScannerOnTheWire::send_due_slices(driver::Io &io) {
  while (current_ && !current_->stack.voxels.empty() && io.now_ns() >= current_->due_ns && !io.stopping()) {
    send_slice(*current_, io);
    send_truth(*current_, io);
    current_->due_ns += std::llround(slice_ms_ * 1e6);
    if (!folder_.empty()) {
      if (const auto written = write_file(*current_); !written) {
        io.skipped(1, written.error().message);
      }
    }
    if (++current_->next == current_->plan.slices) {
      reply(current_->command, bregma_wire_COMMAND_DONE,
            "series " + std::to_string(current_->number) + ": " + std::to_string(current_->plan.slices) +
                " slices of " + current_->name,
            io);
      current_.reset();
    }
  }
}

void ScannerOnTheWire::send_slice(Series &series, driver::Io &io) {
  const Stack &stack = series.stack;
  const std::size_t count = static_cast<std::size_t>(stack.size[0]) * static_cast<std::size_t>(stack.size[1]);
  series.pixels.resize(count);
  const float *from = &stack.voxels[stack.offset(0, 0, series.next)];
  std::transform(from, from + count, series.pixels.begin(),
                 [](float v) { return static_cast<std::uint16_t>(std::clamp(std::lround(v), 0L, 65535L)); });
  wire::ImageSlice slice{};
  slice.frame = ++frame_;
  slice.device_time_ns = io.now_ns();
  Eigen::Matrix3d axes;
  axes << series.plan.along_row, series.plan.along_column, series.plan.normal();
  slice.T_scanner_slice =
      wire::to_wire(geometry::Rigid3<frame::Device, frame::Body>(axes, stack.point_mm(Vector3d(0, 0, series.next))));
  slice.spacing_mm[0] = slice.spacing_mm[1] = series.protocol.pixel_mm();
  slice.columns = static_cast<std::uint32_t>(stack.size[0]);
  slice.rows = static_cast<std::uint32_t>(stack.size[1]);
  slice.pixels._buffer = series.pixels.data();
  slice.pixels._length = slice.pixels._maximum = static_cast<std::uint32_t>(count);
  slice.pixels._release = false;
  slice.thickness_mm = series.protocol.thickness_mm;
  (void)wire::set_name(slice.protocol, series.name);
  slice.series = series.number;
  slice.index = static_cast<std::uint32_t>(series.next) + 1;
  slice.count = static_cast<std::uint32_t>(series.plan.slices);
  slice.read_out = series.plan.read_reversed ? bregma_wire_DIRECTION_ROW_NEGATIVE : bregma_wire_DIRECTION_ROW_POSITIVE;
  slice.phase_encoding = bregma_wire_DIRECTION_COLUMN_POSITIVE;
  slice.bandwidth_Hz_per_pixel = series.protocol.bandwidth_Hz;
  slice.coil_state = series.coils == 0     ? bregma_wire_COILS_OFF
                     : series.polarity > 0 ? bregma_wire_COILS_POSITIVE
                                           : bregma_wire_COILS_NEGATIVE;
  slice.coils_on = series.coils;
  slice.coil_current_mA = std::abs(series.current_mA);
  slice.patient_position = bregma_wire_POSITION_HFS;
  slice.table_stated = true;
  slice.table_mm = table_mm_;
  slice.correction = vendor_ ? bregma_wire_CORRECTION_VENDOR_3D : bregma_wire_CORRECTION_NONE;
  (void)io.publish(slice); // publish() counts dropped samples
}

void ScannerOnTheWire::send_truth(const Series &series, driver::Io &io) const {
  wire::SimulatedTruth out{};
  (void)wire::set_name(out.device, device_);
  (void)wire::set_name(out.step, series.name);
  out.frame = frame_;
  out.time_ns = io.now_ns();
  out.seeded = true;
  out.seed = static_cast<std::uint64_t>(seed_);
  out.T_image_reference = wire::unknown_pose();
  const auto add = [&](const char *body, const BodyPose &T_device_body) {
    wire::TrueTool &tool = out.tools[out.tool_count++];
    (void)wire::set_name(tool.tool, body);
    tool.T_image_tip = wire::unknown_pose();
    tool.T_tracker_tool = wire::to_wire(T_device_body);
  };
  add("Registration frame", scanner_->truth().T_device_base);
  add("Phantom", scanner_->truth().T_device_phantom);
  (void)io.publish(out);
}

base::Result<void> ScannerOnTheWire::write_file(const Series &series) const {
  DicomSlice slice;
  slice.columns = series.stack.size[0];
  slice.rows = series.stack.size[1];
  slice.pixels = series.pixels;
  slice.position_mm = in_patient(series.stack.point_mm(Vector3d(0, 0, series.next)));
  slice.along_row = in_patient(series.plan.along_row);
  slice.along_column = in_patient(series.plan.along_column);
  slice.column_spacing_mm = slice.row_spacing_mm = series.protocol.pixel_mm();
  slice.thickness_mm = series.protocol.thickness_mm;
  slice.study_uid = series.study_uid;
  slice.series_uid = series.series_uid;
  slice.instance = series.next + 1;
  slice.instance_uid = series.series_uid + "." + std::to_string(slice.instance);
  slice.series = static_cast<int>(series.number);
  slice.description = series.name;
  slice.echo_ms = series.protocol.echo_ms;
  slice.repetition_ms = series.protocol.repetition_ms;
  slice.bandwidth_Hz = series.protocol.bandwidth_Hz;
  slice.vendor_corrected = vendor_;
  // A folder per series. Files appear whole: a reader never sees a part of one.
  const std::filesystem::path folder =
      std::filesystem::path(folder_) / (std::to_string(series.number) + "-" + series.name);
  char name[32];
  std::snprintf(name, sizeof name, "%04d.dcm", slice.instance);
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  const std::filesystem::path partial = folder / (std::string(name) + ".part");
  std::ofstream out(partial, std::ios::binary);
  out << dicom_bytes(slice);
  out.close();
  if (!out) {
    return base::failure(partial.string() + ": cannot be written");
  }
  std::filesystem::rename(partial, folder / name, failed);
  return failed ? base::failure(partial.string() + ": " + failed.message()) : base::Result<void>{};
}

void ScannerOnTheWire::reply(const wire::Command &command, wire::CommandResult result, const std::string &text,
                             driver::Io &io) const {
  (void)io.publish(wire::reply_to(command, result, text));
}

} // namespace bregma::sim::scanner
