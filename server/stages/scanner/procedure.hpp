// The guided procedure that registers the robot's base to a scanner [Tuna 2022, figures 1c and 5]:
//
//   scout, phantom | swap | scout, top, bottom, verify | accept
//
// At each bar the operator does something and confirms. Between them the procedure orders the scans by itself, with the
// coils off for a background and on for a foreground, and off again. A field that is valid makes the phantom
// unnecessary. Whatever goes wrong ends the step with a sentence and what to do; the coils are then switched off.
//
// It owns no topic and no thread: the stage passes slices, replies and time, and sends the orders. One thread.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/geometry/points.hpp"
#include "algorithms/mri/coils/robot_registration.hpp"
#include "idl/names.hpp"
#include "server/session/work.hpp"
#include "server/stages/scanner/coil_scans.hpp"
#include "server/stages/scanner/field_measurement.hpp"
#include "server/stages/scanner/slice_stack.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct ProcedureOptions {
  std::string scanner = "Scanner", coils = "Coils"; // devices
  std::optional<mri::CoilFrame> frame;              // none: there is no registration, only correction
  geometry::Points3 phantom_mm;                     // control points in CT; none: the field cannot be measured
  double cell_mm = 15.0, bar_mm = 2.0;
  double max_phantom_moved_mm = 0.3;
  std::uint32_t phantom_again_slices = 48; // of the second scan of the phantom
  std::string field_file;
  int field_days = 90;
  std::string top = "mid-top", bottom = "mid-bottom", verify = "tree"; // patterns; verify may be empty
  std::string verify_protocol = "tree-coronal";
  // Phantom and coils are scanned with both read-outs: every protocol once more, under its name with this suffix.
  bool opposed_read_outs = false;
  double current_mA = 75.0, hold_s = 900.0;
  double limit_mm = 3.0;
  Eigen::Vector3d target_mm = Eigen::Vector3d::Zero(); // in Base
  double uncorrected_sigma_mm = 1.0;
  std::int64_t reply_timeout_ns = 10'000'000'000;
  std::int64_t series_timeout_ns = 900'000'000'000; // until the next slice
};

// An order to a device, for the stage to send; the id comes back in the reply.
struct DeviceOrder {
  std::uint64_t id = 0;
  std::string device;
  wire::CommandKind kind = bregma_wire_COMMAND_UNKNOWN;
  std::vector<std::string> values; // in the order of the command's fields
};

struct ProcedureAnswer {
  bool done = false;
  std::string text;
};

class Procedure {
public:
  // elsewhere: runs long work on another thread.
  using Elsewhere = std::function<void(const std::function<void()> &job)>;
  Procedure(ProcedureOptions options, Elsewhere elsewhere);

  // ---- commands ----
  [[nodiscard]] ProcedureAnswer start(const std::string &device, std::int64_t now_ns);
  [[nodiscard]] ProcedureAnswer confirm(const std::string &device, const std::string &step, std::int64_t now_ns);
  [[nodiscard]] ProcedureAnswer accept(const std::string &device, std::int64_t now_ns);
  [[nodiscard]] ProcedureAnswer reset(const std::string &device, std::int64_t now_ns);

  // ---- what happens ----
  // Every accepted slice of the scanner. True if it belongs to the procedure.
  bool on_slice(const wire::ImageSlice &slice, std::int64_t now_ns);
  // Number of programs that may send slices.
  void on_writers(std::uint32_t alive, std::int64_t now_ns) {
    if (alive > 0) {
      no_writer_ns_ = 0;
    } else if (no_writer_ns_ == 0) {
      no_writer_ns_ = now_ns;
    }
  }
  // Slices come from another program than before: it counts its series anew, and knows of no order.
  void on_other_scanner();
  // A slice that was refused at the input; text: why.
  void on_refused(const wire::ImageSlice &slice, const std::string &text, std::int64_t now_ns);
  // What the drivers of scanner and coils state once per second. One that states nothing is not watched.
  void on_driver(const wire::DriverHealth &health, std::int64_t now_ns);
  void on_reply(const wire::CommandReply &reply, std::int64_t now_ns);
  void poll(std::int64_t now_ns); // time-outs, results of other threads, expiry

  void use_field(ScannerField field) { field_ = std::move(field); }
  // The calendar is the wall clock: a field that it calls expired is not used.
  void set_wall_lead(std::int64_t lead_ns) { wall_lead_ns_ = lead_ns; }

  // Ordered by the next poll, again and again until it is confirmed.
  void switch_off();

  // ---- results ----
  [[nodiscard]] std::vector<DeviceOrder> take_orders() { return std::exchange(orders_, {}); }
  // Everything but time, device and counts of the stage. Texts, numbers and poses as they are now.
  void fill(wire::ScannerRegistration &out, std::int64_t now_ns) const;
  [[nodiscard]] std::uint64_t revision() const { return revision_; } // incremented at every change
  [[nodiscard]] ScannerPoseView pose() const;
  // Not valid where there is none, or it has expired.
  [[nodiscard]] const std::optional<ScannerField> &field() const { return field_; }
  [[nodiscard]] bool field_is_valid(std::int64_t now_ns) const {
    return field_ && !has_expired(field_->expires_ns, now_ns);
  }
  // Coils were ordered on, and no controller has confirmed that they are off.
  [[nodiscard]] bool coils_may_be_on() const { return coils_ordered_; }
  // The coils could not be switched off: an alarm. Empty: all is well.
  [[nodiscard]] const std::string &coils_fault() const { return coils_fault_; }
  [[nodiscard]] wire::ScannerValidity validity() const {
    return accepted_ ? validity_ : bregma_wire_SCANNER_VALIDITY_NONE;
  }
  [[nodiscard]] const std::string &validity_text() const { return validity_text_; }

private:
  static constexpr std::int64_t kStragglers_ns = 3'000'000'000; // for slices that come after the reply to their order
  static constexpr const char *kOff = "background";             // pattern
  [[nodiscard]] static std::string name_of(wire::ScannerStep step);

  enum class Role : std::uint8_t { kScout, kPhantom, kPhantomAgain, kBackground, kForeground, kOff };
  struct PlannedScan {
    Role role = Role::kScout;
    std::string protocol; // empty: only the coils
    std::uint32_t slices = 0;
    std::string pattern;   // empty: the coils stay as they are
    bool reversed = false; // the read-out
  };
  enum class Phase : std::uint8_t { kIdle, kSwitching, kWaiting, kReceiving, kComputing };
  struct Accepted {
    std::uint32_t revision = 0;
    geometry::UncertainPose<mri::frame::Base, mri::frame::Device> T_base_device;
    geometry::Matrix6d fitted_covariance = geometry::Matrix6d::Zero(); // before the verification
    std::vector<mri::LocatedCoil> coils;                               // of the fit
    double tre_95_mm = 0.0;
    std::int64_t time_ns = 0;
    std::optional<double> table_mm;
    bool corrected = false;
    std::int64_t field_expires_ns = 0; // of the field that corrected it; 0: never
  };

  struct SeenDriver {
    std::int64_t started_ns = 0;
    std::uint64_t connections = 0;
    std::int64_t time_ns = 0; // of its last statement
    bool connected = false, seen = false;
    [[nodiscard]] bool is_silent(std::int64_t now_ns) const { return seen && now_ns - time_ns > 10'000'000'000; }
  };

  // procedure.cpp: steps
  void begin(wire::ScannerStep step, std::int64_t now_ns);
  void end_scan(std::int64_t now_ns);
  void next_scan(std::int64_t now_ns);
  void end_step(std::int64_t now_ns);
  void wait_for_operator(wire::ScannerStep step, const std::string &text, const std::string &next);
  void fail(const std::string &text, const std::string &next = {});
  void placed_by_hand(); // the accepted registration is void
  void forget_scans();   // of the coils, and the estimate by them
  void changed() { ++revision_; }
  [[nodiscard]] bool busy() const { return phase_ != Phase::kIdle; }
  [[nodiscard]] bool has_expired(std::int64_t expires_ns, std::int64_t now_ns) const { // 0: never
    return expires_ns != 0 && now_ns + std::max<std::int64_t>(wall_lead_ns_, 0) >= expires_ns;
  }
  // An estimate was found and not accepted yet. Otherwise coils verify the accepted registration.
  [[nodiscard]] bool found_anew() const;
  [[nodiscard]] bool scans(Role role) const { return busy() && scan_ < plan_.size() && plan_[scan_].role == role; }
  [[nodiscard]] std::optional<std::string> refuse_device(const std::string &device) const;
  [[nodiscard]] std::optional<std::string> wrong_input(const wire::ImageSlice &slice) const;
  // Top, bottom or verify: protocol of its scans, pattern of its coils, and where the scans are kept.
  struct CoilStep {
    std::string protocol;
    const std::string &pattern;
    std::optional<CoilScans> &scans;
  };
  [[nodiscard]] CoilStep coil_step(wire::ScannerStep step);
  [[nodiscard]] CoilScans &scans_of_step() { return *coil_step(step_).scans; }
  [[nodiscard]] std::vector<PlannedScan> plan_of(wire::ScannerStep step);
  [[nodiscard]] std::string retry_text() const;

  // procedure_devices.cpp: orders and replies
  void start_scan(std::int64_t now_ns);
  void acquire(std::int64_t now_ns);
  void order(const std::string &device, wire::CommandKind kind, std::vector<std::string> values, std::int64_t now_ns);
  void confirmed_off();
  void poll_step(std::int64_t now_ns);
  [[nodiscard]] std::uint64_t new_id(std::int64_t now_ns);

  // procedure_results.cpp: field, registration, verification
  void measure(std::int64_t now_ns);
  void take_field();
  void estimate(std::int64_t now_ns);
  void check(std::int64_t now_ns);
  // A field is there that holds for the scans of the coils.
  [[nodiscard]] bool can_correct(std::int64_t now_ns) const;
  [[nodiscard]] bool is_opposite_to_field(const CoilScans &scans, std::int64_t now_ns) const;
  // scans: those whose coils are corrected.
  [[nodiscard]] mri::RobotRegistrationOptions registration_options(const CoilScans &scans, std::int64_t now_ns) const;
  void watch_table(const wire::ImageSlice &slice);
  void void_registration(wire::ScannerValidity validity, const std::string &text);
  void fill_coils(wire::ScannerRegistration &out) const;

  ProcedureOptions options_;
  Elsewhere elsewhere_;
  wire::ScannerStep step_ = bregma_wire_SCANNER_STEP_IDLE;
  wire::ScannerActivity activity_ = bregma_wire_SCANNER_ACTIVITY_NONE;
  std::string text_ = "not started", next_ = "start the registration of the scanner";
  std::vector<DeviceOrder> orders_;
  // 0: no order yet. A daemon that is started again does not count from 1: replies to its predecessor may be under way.
  std::uint64_t next_id_ = 0, awaited_id_ = 0, off_id_ = 0;
  std::int64_t off_deadline_ns_ = 0; // of an order to switch off; 0: the coils are off, or a step switches them
  bool coils_ordered_ = false;
  std::int64_t hold_ends_ns_ = 0; // of the coils that were ordered on
  std::string coils_fault_;
  SeenDriver scanner_driver_, coils_driver_;
  std::int64_t no_writer_ns_ = 0; // since when no program sends slices; 0: one does

  std::vector<PlannedScan> plan_;
  std::size_t scan_ = 0;
  Phase phase_ = Phase::kIdle;
  std::int64_t deadline_ns_ = 0;
  bool series_replied_ = false;   // the scanner states that the series is complete
  std::uint32_t last_series_ = 0; // of the scanner
  std::optional<SliceStack> series_;
  wire::ImageSlice header_{}; // of the series under way, without pixels

  std::optional<image::Image<float, 3>> phantom_, phantom_again_, phantom_reversed_;
  wire::ImageSlice phantom_header_{};
  std::shared_ptr<JobResult<base::Result<ScannerField>>> measuring_;
  std::shared_ptr<std::atomic<bool>> unwanted_; // the measurement under way was reset
  std::optional<ScannerField> field_;
  std::int64_t wall_lead_ns_ = 0;

  std::optional<CoilScans> top_, bottom_, tree_;
  std::optional<mri::RobotRegistration> estimate_;
  std::uint32_t estimate_revision_ = 0;
  bool estimate_corrected_ = false;
  geometry::Matrix6d fitted_covariance_ = geometry::Matrix6d::Zero(); // of the estimate, before its verification
  double verified_mm_ = 0.0, duration_ms_ = 0.0;
  std::vector<mri::LocatedCoil> verifying_;

  std::optional<Accepted> accepted_;
  wire::ScannerValidity validity_ = bregma_wire_SCANNER_VALIDITY_NONE;
  std::string validity_text_;
  std::uint64_t revision_ = 1;
};

} // namespace bregma::server
