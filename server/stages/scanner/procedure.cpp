#include "server/stages/scanner/procedure.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace bregma::server {

namespace {

constexpr const char *kReversed = "-reversed"; // suffix of protocols

constexpr std::array kStepNames = {"unknown", "idle",   "scout",  "phantom", "swap", "frame scout",
                                   "top",     "bottom", "verify", "accept",  "done"};

} // namespace

std::string Procedure::name_of(wire::ScannerStep step) { return kStepNames.at(static_cast<std::size_t>(step)); }

Procedure::Procedure(ProcedureOptions options, Elsewhere elsewhere)
    : options_(std::move(options)), elsewhere_(std::move(elsewhere)) {}

std::optional<std::string> Procedure::refuse_device(const std::string &device) const {
  if (device != options_.scanner) {
    return "\"" + device + "\" is not the configured scanner " + options_.scanner;
  }
  return std::nullopt;
}

ProcedureAnswer Procedure::start(const std::string &device, std::int64_t now_ns) {
  if (const auto wrong = refuse_device(device)) {
    return {false, *wrong};
  }
  if (!options_.frame) {
    return {false, "no registration frame is configured (scanner.frame)"};
  }
  if (busy()) {
    return {false, "step " + name_of(step_) + " is under way: wait, or reset"};
  }
  forget_scans();
  if (can_correct(now_ns)) {
    wait_for_operator(bregma_wire_SCANNER_STEP_SWAP, "the distortion field " + field_->identity + " is valid",
                      "place the registration frame, then confirm swap; or place the phantom and confirm phantom");
    return {true, text_ + ": " + next_};
  }
  if (options_.phantom_mm.cols() == 0) {
    wait_for_operator(bregma_wire_SCANNER_STEP_SWAP,
                      field_is_valid(now_ns) ? "the distortion field is of one read-out, and no phantom is configured"
                                             : "there is no distortion field, and no phantom is configured",
                      "place the registration frame, then confirm swap: it is registered without correction");
    return {true, text_ + ": " + next_};
  }
  begin(bregma_wire_SCANNER_STEP_SCOUT, now_ns);
  return {true, "the phantom is scanned"};
}

ProcedureAnswer Procedure::confirm(const std::string &device, const std::string &step, std::int64_t now_ns) {
  if (const auto wrong = refuse_device(device)) {
    return {false, *wrong};
  }
  if (step_ == bregma_wire_SCANNER_STEP_IDLE) {
    return {false, "start the registration of the scanner first"};
  }
  if (busy()) {
    return {false, "step " + name_of(step_) + " is under way: wait, or reset"};
  }
  if (step == "phantom") {
    if (options_.phantom_mm.cols() == 0) {
      return {false, "no control points of the phantom are configured (scanner.phantom)"};
    }
    placed_by_hand();
    begin(bregma_wire_SCANNER_STEP_SCOUT, now_ns);
    return {true, "the phantom is scanned"};
  }
  if (step == "swap" || step == "top") {
    if (step_ < bregma_wire_SCANNER_STEP_SWAP) {
      return {
          false,
          "the phantom is not measured: confirm phantom first; or start again, to go on with the field that is there"};
    }
    if (step == "swap") {
      placed_by_hand();
    }
    begin(step == "swap" ? bregma_wire_SCANNER_STEP_FRAME_SCOUT : bregma_wire_SCANNER_STEP_TOP, now_ns);
    return {true, "the registration frame is scanned"};
  }
  if (step == "bottom") {
    if (!top_ || !top_->finished()) {
      return {false, "the top is not scanned: confirm top first"};
    }
    begin(bregma_wire_SCANNER_STEP_BOTTOM, now_ns);
    return {true, "the bottom of the registration frame is scanned"};
  }
  if (step == "verify") {
    if (options_.verify.empty()) {
      return {false, "no coils verify (scanner.verify)"};
    }
    if (!found_anew() && !accepted_) {
      return {false, "nothing is registered yet: confirm top"};
    }
    if (!found_anew() && validity_ != bregma_wire_SCANNER_VALID) {
      return {false, "the registration is void, " + validity_text_ + ": confirm top to register anew"};
    }
    begin(bregma_wire_SCANNER_STEP_VERIFY, now_ns);
    return {true, "the coils that verify are scanned"};
  }
  return {false, "\"" + step + "\" is no step to confirm: phantom, swap, top, bottom or verify"};
}

ProcedureAnswer Procedure::accept(const std::string &device, std::int64_t now_ns) {
  if (const auto wrong = refuse_device(device)) {
    return {false, *wrong};
  }
  if (step_ != bregma_wire_SCANNER_STEP_ACCEPT || activity_ != bregma_wire_SCANNER_WAITS || !found_anew()) {
    return {false, "there is nothing to accept: step " + name_of(step_) + ", " + next_};
  }
  const bool field = field_is_valid(now_ns);
  if (estimate_corrected_ && !field) {
    return {false, "the distortion field has expired since the scans: measure it again (confirm phantom)"};
  }
  accepted_ = Accepted{estimate_revision_, estimate_->T_base_device, fitted_covariance_,
                       estimate_->coils,   estimate_->tre_95_mm,     now_ns,
                       top_->table_mm(),   estimate_corrected_,      estimate_corrected_ ? field_->expires_ns : 0};
  validity_ = bregma_wire_SCANNER_VALID;
  validity_text_.clear();
  wait_for_operator(bregma_wire_SCANNER_STEP_DONE,
                    std::string("the robot is registered to the scanner") +
                        (field ? "" : "; without a distortion field slices are not corrected, and show no tip"),
                    options_.verify.empty() ? "confirm top to register anew"
                                            : "confirm verify to check it again, or top to register anew");
  return {true, text_};
}

ProcedureAnswer Procedure::reset(const std::string &device, std::int64_t /*now_ns*/) {
  if (const auto wrong = refuse_device(device)) {
    return {false, *wrong};
  }
  if (options_.frame) {
    switch_off();
  }
  phase_ = Phase::kIdle;
  if (measuring_) {
    unwanted_->store(true);
    measuring_.reset();
  }
  series_.reset();
  forget_scans();
  accepted_.reset();
  step_ = bregma_wire_SCANNER_STEP_IDLE;
  activity_ = bregma_wire_SCANNER_ACTIVITY_NONE;
  text_ = "reset";
  next_ = "start the registration of the scanner";
  changed();
  return {true, std::string(options_.frame ? "the coils are ordered off; " : "") + "the registration is void"};
}

void Procedure::forget_scans() {
  top_.reset();
  bottom_.reset();
  tree_.reset();
  estimate_.reset();
  verifying_.clear();
}

void Procedure::placed_by_hand() {
  if (accepted_ && validity_ == bregma_wire_SCANNER_VALID) {
    void_registration(bregma_wire_SCANNER_FRAME_MOVED,
                      "phantom or frame were placed by hand since the registration: register again");
  }
}

bool Procedure::found_anew() const {
  return estimate_ && estimate_->verdict == mri::RegistrationVerdict::kFound &&
         (!accepted_ || accepted_->revision != estimate_revision_);
}

void Procedure::begin(wire::ScannerStep step, std::int64_t now_ns) {
  step_ = step;
  scan_ = 0;
  if (step == bregma_wire_SCANNER_STEP_SCOUT || step == bregma_wire_SCANNER_STEP_FRAME_SCOUT) {
    forget_scans(); // phantom and frame are placed by hand: what was scanned before lies elsewhere
  }
  plan_ = plan_of(step);
  if (step == bregma_wire_SCANNER_STEP_TOP) {
    bottom_.reset();
    tree_.reset();
  }
  if (step == bregma_wire_SCANNER_STEP_TOP || step == bregma_wire_SCANNER_STEP_BOTTOM) {
    estimate_.reset();
    verifying_.clear();
  }
  if (step >= bregma_wire_SCANNER_STEP_TOP && step <= bregma_wire_SCANNER_STEP_VERIFY) {
    const CoilStep coils = coil_step(step);
    auto on = coils_of_pattern(*options_.frame, coils.pattern);
    if (!on) {
      return fail(on.error().message);
    }
    coils.scans.emplace(name_of(step), *on, options_.opposed_read_outs);
  }
  start_scan(now_ns);
}

std::vector<Procedure::PlannedScan> Procedure::plan_of(wire::ScannerStep step) {
  if (step == bregma_wire_SCANNER_STEP_SCOUT || step == bregma_wire_SCANNER_STEP_FRAME_SCOUT) {
    return {{Role::kScout, "scout", 0, {}}};
  }
  std::vector<PlannedScan> out;
  // With both read-outs the coils stay as they are for the second scan.
  const auto add = [&](Role role, const std::string &protocol, const std::string &pattern) {
    out.push_back({role, protocol, 0, pattern});
    if (options_.opposed_read_outs) {
      out.push_back({role, protocol + kReversed, 0, {}, true});
    }
  };
  if (step == bregma_wire_SCANNER_STEP_PHANTOM) {
    add(Role::kPhantom, "phantom", {});
    out.push_back({Role::kPhantomAgain, "phantom", options_.phantom_again_slices, {}});
    return out;
  }
  const CoilStep coils = coil_step(step);
  add(Role::kBackground, coils.protocol, kOff);
  add(Role::kForeground, coils.protocol, coils.pattern);
  out.push_back({Role::kOff, {}, 0, kOff});
  return out;
}

Procedure::CoilStep Procedure::coil_step(wire::ScannerStep step) {
  switch (step) {
  case bregma_wire_SCANNER_STEP_TOP:
    return {"top", options_.top, top_};
  case bregma_wire_SCANNER_STEP_BOTTOM:
    return {"bottom", options_.bottom, bottom_};
  default:
    return {options_.verify_protocol, options_.verify, tree_};
  }
}

std::optional<std::string> Procedure::wrong_input(const wire::ImageSlice &slice) const {
  if (plan_[scan_].role == Role::kScout) {
    return std::nullopt;
  }
  if (slice.correction != bregma_wire_CORRECTION_NONE) {
    return slice.correction == bregma_wire_CORRECTION_UNKNOWN
               ? "the scanner does not state whether its images are corrected"
               : "the images are corrected by the vendor already: switch its distortion correction off";
  }
  if (!stated_position(slice)) {
    return "the scanner does not state the patient position";
  }
  return std::nullopt;
}

bool Procedure::on_slice(const wire::ImageSlice &slice, std::int64_t now_ns) {
  watch_table(slice);
  if (phase_ == Phase::kWaiting && slice.series != last_series_) {
    if (wire::view(slice.protocol) != plan_[scan_].protocol) {
      const std::string note = "series " + std::to_string(slice.series) + " is \"" + wire::text(slice.protocol) +
                               "\", not \"" + plan_[scan_].protocol + "\": it is not used";
      if (text_ != note) {
        text_ = note;
        changed();
      }
      return false;
    }
    if (const auto wrong = wrong_input(slice)) {
      last_series_ = slice.series;
      fail(*wrong);
      return true;
    }
    series_.emplace(slice);
    header_ = slice;
    header_.pixels = {};
    phase_ = Phase::kReceiving;
    last_series_ = slice.series;
    text_ = "receives series " + std::to_string(slice.series) + ", " + plan_[scan_].protocol;
  } else if (phase_ == Phase::kReceiving && slice.series == series_->series()) {
    if (table_moved(stated_table(header_), stated_table(slice))) {
      fail("the table moved within series " + std::to_string(slice.series));
      return true;
    }
    if (const auto added = series_->add(slice); !added) {
      fail("slice " + std::to_string(slice.index) + " of series " + std::to_string(slice.series) + ": " +
           added.error());
      return true;
    }
  } else {
    last_series_ = phase_ == Phase::kWaiting || phase_ == Phase::kReceiving ? last_series_ : slice.series;
    return false;
  }
  deadline_ns_ = now_ns + (series_replied_ ? kStragglers_ns : options_.series_timeout_ns);
  if (plan_[scan_].role == Role::kForeground) {
    if (const auto added = scans_of_step().pair(plan_[scan_].reversed).add(*series_, slice.index - 1, slice); !added) {
      fail(added.error().message);
      return true;
    }
  }
  changed();
  if (series_->complete()) {
    end_scan(now_ns);
  }
  return true;
}

void Procedure::on_other_scanner() {
  last_series_ = 0;
  // Background and foreground are of one program: two scanners of one name may both have been ordered.
  if (phase_ == Phase::kReceiving || (phase_ != Phase::kComputing && busy() && scan_ > 0)) {
    fail("another program than before sends the slices of " + options_.scanner +
         ": it was started again, or two have this name");
  }
}

void Procedure::on_refused(const wire::ImageSlice &slice, const std::string &text, std::int64_t /*now_ns*/) {
  // A series of which a slice was refused is never used: what is left of it may be another scene.
  if (phase_ == Phase::kReceiving && slice.series == series_->series()) {
    fail("a slice of series " + std::to_string(slice.series) + " was refused: " + text);
  }
}

void Procedure::end_scan(std::int64_t now_ns) {
  const Role role = plan_[scan_].role;
  const auto check = [&](const base::Result<void> &result) {
    if (!result) {
      fail(result.error().message);
    }
    return result.has_value();
  };
  if (role == Role::kScout) {
    bool signal = false;
    for (std::uint32_t k = 0; k < series_->expected(); ++k) {
      const std::vector<float> &slice = series_->slice(k);
      signal = signal || std::any_of(slice.begin(), slice.end(), [](float v) { return v > 0.0F; });
    }
    if (!signal) {
      return fail("the scout shows no signal");
    }
  } else if (role == Role::kPhantom || role == Role::kPhantomAgain) {
    auto stack = series_->stack();
    if (!stack) {
      return fail("the phantom: " + stack.error());
    }
    const bool reversed = plan_[scan_].reversed;
    if (reversed && !are_opposed(movement_by_b0(phantom_header_), movement_by_b0(header_))) {
      return fail("the scanner does not state opposed read-outs, with the same bandwidth, for the protocols phantom "
                  "and phantom-reversed");
    }
    (role == Role::kPhantomAgain ? phantom_again_ : reversed ? phantom_reversed_ : phantom_) = std::move(*stack);
    if (role == Role::kPhantom && !reversed) {
      phantom_header_ = header_;
    }
  } else if (role == Role::kBackground) {
    if (!check(scans_of_step().set_background(plan_[scan_].reversed, *series_, header_))) {
      return;
    }
  } else {
    if (!check(scans_of_step().pair(plan_[scan_].reversed).finish(*series_))) {
      return;
    }
    if (step_ == bregma_wire_SCANNER_STEP_BOTTOM && bottom_->finished()) {
      estimate(now_ns);
    }
  }
  series_.reset();
  next_scan(now_ns);
}

void Procedure::next_scan(std::int64_t now_ns) {
  if (++scan_ < plan_.size()) {
    start_scan(now_ns);
  } else {
    phase_ = Phase::kIdle;
    end_step(now_ns);
  }
}

void Procedure::end_step(std::int64_t now_ns) {
  switch (step_) {
  case bregma_wire_SCANNER_STEP_SCOUT:
    return begin(bregma_wire_SCANNER_STEP_PHANTOM, now_ns);
  case bregma_wire_SCANNER_STEP_PHANTOM:
    return measure(now_ns);
  case bregma_wire_SCANNER_STEP_FRAME_SCOUT:
    return begin(bregma_wire_SCANNER_STEP_TOP, now_ns);
  case bregma_wire_SCANNER_STEP_TOP:
    return begin(bregma_wire_SCANNER_STEP_BOTTOM, now_ns);
  case bregma_wire_SCANNER_STEP_BOTTOM:
    if (estimate_->verdict != mri::RegistrationVerdict::kFound) {
      return fail(std::string(mri::name(estimate_->verdict)) + ": " + estimate_->reason, "mend it, then confirm top");
    }
    if (!options_.verify.empty()) {
      return begin(bregma_wire_SCANNER_STEP_VERIFY, now_ns);
    }
    return wait_for_operator(bregma_wire_SCANNER_STEP_ACCEPT, "the robot is found", "accept the registration");
  case bregma_wire_SCANNER_STEP_VERIFY:
    return check(now_ns);
  default:
    return;
  }
}

void Procedure::wait_for_operator(wire::ScannerStep step, const std::string &text, const std::string &next) {
  step_ = step;
  phase_ = Phase::kIdle;
  activity_ = bregma_wire_SCANNER_WAITS;
  text_ = text;
  next_ = next;
  changed();
}

std::string Procedure::retry_text() const {
  switch (step_) {
  case bregma_wire_SCANNER_STEP_SCOUT:
  case bregma_wire_SCANNER_STEP_PHANTOM:
    return "mend it, then confirm phantom";
  case bregma_wire_SCANNER_STEP_FRAME_SCOUT:
    return "mend it, then confirm swap";
  case bregma_wire_SCANNER_STEP_BOTTOM:
    return "mend it, then confirm bottom; or top, if the frame moved";
  case bregma_wire_SCANNER_STEP_VERIFY:
    return "mend it, then confirm verify; or top, if the frame moved";
  default:
    return "mend it, then confirm top";
  }
}

void Procedure::fail(const std::string &text, const std::string &next) {
  if (step_ >= bregma_wire_SCANNER_STEP_TOP && step_ <= bregma_wire_SCANNER_STEP_VERIFY) {
    switch_off();
  }
  phase_ = Phase::kIdle;
  series_.reset();
  activity_ = bregma_wire_SCANNER_FAILED;
  text_ = text;
  next_ = next.empty() ? retry_text() : next;
  changed();
}

} // namespace bregma::server
