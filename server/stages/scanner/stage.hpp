// Stage scanner: slices of an MR scanner. It guides the registration of the robot's base to the scanner
// (procedure.hpp), and corrects every other slice and publishes it with the tip of the robot's tool
// (slice_corrector.hpp).
//
// A worker. The distortion field is computed on another thread (Work::kScanner); a slice takes milliseconds.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "base/parameters.hpp"
#include "idl/host_clock.hpp"
#include "server/inputs/input_guard.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/runtime/mailbox.hpp"
#include "server/runtime/spsc_ring.hpp"
#include "server/stages/host.hpp"
#include "server/stages/monitoring/alarm_conditions.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/scanner/procedure.hpp"
#include "server/stages/scanner/slice_corrector.hpp"
#include "server/stages/scanner/slice_guard.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct ScannerParameters {
  std::string device = ProcedureOptions{}.scanner;
  std::string coils = ProcedureOptions{}.coils;
  std::string frame, phantom, field; // files; empty: none
  double cell_mm = ProcedureOptions{}.cell_mm, bar_mm = ProcedureOptions{}.bar_mm;
  std::int64_t field_days = ProcedureOptions{}.field_days;
  double phantom_moved_mm = ProcedureOptions{}.max_phantom_moved_mm;
  std::string top = ProcedureOptions{}.top, bottom = ProcedureOptions{}.bottom, verify = ProcedureOptions{}.verify;
  std::string verify_protocol = ProcedureOptions{}.verify_protocol;
  bool opposed_read_outs = ProcedureOptions{}.opposed_read_outs;
  double current_mA = ProcedureOptions{}.current_mA, hold_s = ProcedureOptions{}.hold_s;
  double limit_mm = ProcedureOptions{}.limit_mm;
  double target_x_mm = 0.0, target_y_mm = 0.0, target_z_mm = 0.0;
  double series_timeout_s = 900.0;
  bool brightness = true;
};
void declare(base::ParameterSet &set, ScannerParameters &parameters);

class ScannerStage final : public Stage {
public:
  static constexpr const char *kName = "scanner";
  // Client of the commands to scanner and coils.
  static constexpr const char *kClient = "bregmad scanner";
  using Parameters = ScannerParameters;

  // Throws std::invalid_argument for files that cannot be read and for patterns that the frame does not have.
  ScannerStage(const ScannerParameters &parameters, const StageContext &context);
  // Switches the coils off, where they may be on.
  ~ScannerStage() override;
  void connect(ScannerInbox &commands, const runtime::LatestValue<RobotToolsView> &tools);

  void step(const Moment &now) noexcept override;

  runtime::LatestValue<ScannerPoseView> pose;
  runtime::LatestValue<inputs::StreamHealth> devices; // per tick
  StageAnswers answers;
  AlarmEvents conditions;

private:
  static constexpr std::size_t kMaxWaiting = 128; // slices that wait for their correction

  void advance(const Moment &now);
  void take_commands(const Moment &now);
  void take_slices(const Moment &now);
  void refused(const wire::ImageSlice &slice, const std::string &text, const Moment &now);
  [[nodiscard]] std::uint64_t slices_refused() const { return guard_.refused() + not_corrected_; }
  void send_orders(const Moment &now);
  void correct(const Moment &now);
  void publish_corrected(CorrectedPixels pixels, const ScannerField &field, const Moment &now);
  void put_tip(wire::CorrectedSlice &out, std::int64_t now_ns) const;
  void watch(const Moment &now);
  void publish(const Moment &now);

  std::string device_;
  Host &host_;
  Subscriber<wire::ImageSlice> slices_;
  Subscriber<wire::CommandReply> replies_;
  Subscriber<wire::DriverHealth> drivers_;
  Publisher<wire::Command> commands_;
  Publisher<wire::ScannerRegistration> states_;
  Publisher<wire::CorrectedSlice> corrected_;
  ScannerInbox *inbox_ = nullptr;
  runtime::LatestInput<RobotToolsView> tools_;
  SliceGuard guard_;
  Procedure procedure_;
  SliceCorrector corrector_;
  AlarmConditions alarms_;
  std::deque<OwnedSlice> waiting_;
  CorrectedPixels pixels_; // of the slice published last
  std::uint64_t published_revision_ = 0;
  std::int64_t published_ns_ = 0; // monotonic
  std::int64_t last_ns_ = 0;      // UTC, of the last step
  std::int64_t refused_ns_ = 0;   // UTC, of the last refusal; 0: none
  std::uint64_t slices_corrected_ = 0;
  std::uint64_t not_corrected_ = 0;   // accepted, but already corrected, or skipped since newer ones came
  std::vector<StageAnswer> answered_; // sent when the state that they led to is published
  std::string refused_text_;
  std::uint64_t seen_refused_ = 0, seen_corrected_ = 0;
};

} // namespace bregma::server
