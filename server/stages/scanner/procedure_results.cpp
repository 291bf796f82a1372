// What the scans of the procedure give: the field, the registration, its verification, and their publication.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <utility>

#include "algorithms/geometry/rigid3.hpp"
#include "algorithms/mri/coils/field_correction.hpp"
#include "server/session/session_text.hpp"
#include "server/stages/scanner/procedure.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

constexpr double kB0Changed_mm = 0.2; // at one coil; without any change 0.07 are found (./dev bench mri)

constexpr const char *kOppositeReadOut =
    "the distortion field was measured with the opposite read-out, so B0 would be doubled: measure it with the "
    "read-out of these scans, or set scanner.opposed_read_outs";

wire::ScannerVerdict verdict_of(mri::RegistrationVerdict verdict) {
  return static_cast<wire::ScannerVerdict>(bregma_wire_SCANNER_VERDICT_FOUND + static_cast<int>(verdict));
}

} // namespace

void Procedure::measure(std::int64_t now_ns) {
  FieldMeasurement input;
  input.phantom = std::move(*phantom_);
  input.again = std::move(phantom_again_);
  phantom_.reset();
  phantom_again_.reset();
  input.reversed = std::exchange(phantom_reversed_, std::nullopt);
  input.mm_per_Hz = movement_by_b0(phantom_header_);
  input.reference_mm = options_.phantom_mm;
  input.cell_mm = options_.cell_mm;
  input.bar_mm = options_.bar_mm;
  input.max_moved_mm = options_.max_phantom_moved_mm;
  input.position = *stated_position(phantom_header_);
  input.scanner = options_.scanner;
  input.protocol = wire::text(phantom_header_.protocol);
  input.file = options_.field_file;
  input.days = options_.field_days;
  input.utc_ns = now_ns + wall_lead_ns_;
  unwanted_ = std::make_shared<std::atomic<bool>>(false);
  input.unwanted = unwanted_;
  measuring_ = std::make_shared<JobResult<base::Result<ScannerField>>>();
  phase_ = Phase::kComputing;
  activity_ = bregma_wire_SCANNER_COMPUTES;
  text_ = "finds the control points of the phantom";
  changed();
  elsewhere_([result = measuring_, input = std::make_shared<FieldMeasurement>(std::move(input))] {
    try {
      result->set(measure_field(*input));
    } catch (const std::exception &error) {
      result->set(base::failure(error.what()));
    }
  });
}

void Procedure::take_field() {
  auto *result = measuring_ ? measuring_->get() : nullptr;
  if (result == nullptr) {
    return;
  }
  base::Result<ScannerField> field = std::move(*result);
  measuring_.reset();
  phase_ = Phase::kIdle;
  if (!field) {
    return fail(field.error().message);
  }
  field_ = std::move(*field);
  wait_for_operator(bregma_wire_SCANNER_STEP_SWAP,
                    "distortion " + mm(field_->initial_mm) + ", " + mm(field_->residual_mm) +
                        " left at points held out, " + std::to_string(field_->points) + " control points",
                    "replace the phantom by the registration frame, then confirm swap");
}

bool Procedure::can_correct(std::int64_t now_ns) const {
  return field_is_valid(now_ns) && (!options_.opposed_read_outs || field_->scans->has_b0());
}

bool Procedure::is_opposite_to_field(const CoilScans &scans, std::int64_t now_ns) const {
  return can_correct(now_ns) && field_->scans->is_opposite(in_field(*field_, scans.mm_per_Hz()));
}

mri::RobotRegistrationOptions Procedure::registration_options(const CoilScans &scans, std::int64_t now_ns) const {
  mri::RobotRegistrationOptions out;
  out.limit_mm = options_.limit_mm;
  out.target_mm = options_.target_mm;
  out.uncorrected_sigma_mm = options_.uncorrected_sigma_mm;
  if (can_correct(now_ns)) {
    const mri::ScanFields &fields = *field_->scans;
    const Eigen::Vector3d mm_per_Hz = in_field(*field_, scans.mm_per_Hz());
    out.correction = mri::correction_by(scans.opposed() ? fields.table() : fields.of_scan(mm_per_Hz), field_->position);
    if (scans.opposed()) {
      out.mapped_b0 = mri::mapped_b0(fields, field_->position, mm_per_Hz);
    }
  }
  if (options_.frame->R_patient_base) {
    const Eigen::Matrix3d R_device_base =
        mri::T_device_patient(scans.position()).rotation_matrix() * *options_.frame->R_patient_base;
    out.expected_rotation = Eigen::Quaterniond(R_device_base.transpose());
  }
  return out;
}

void Procedure::estimate(std::int64_t now_ns) {
  const auto began = std::chrono::steady_clock::now();
  ++estimate_revision_;
  estimate_corrected_ = can_correct(now_ns);
  mri::RobotRegistration result;
  if (table_moved(top_->table_mm(), bottom_->table_mm())) {
    result.reason = "the table moved between the scans of top and bottom";
  } else if (top_->position() != bottom_->position()) {
    result.reason = "top and bottom have different patient positions";
  } else if ((top_->mm_per_Hz() - bottom_->mm_per_Hz()).norm() > 0.01 * top_->mm_per_Hz().norm()) {
    result.reason = "top and bottom have different read-outs or bandwidths";
  } else if (is_opposite_to_field(*top_, now_ns)) {
    result.reason = kOppositeReadOut;
  }
  if (result.reason.empty()) {
    const std::array scans{top_->scan(), bottom_->scan()};
    const std::array artefacts{top_->artefacts(), bottom_->artefacts()};
    result = mri::register_artefacts(*options_.frame, scans, artefacts, registration_options(*top_, now_ns));
  }
  estimate_ = std::move(result);
  fitted_covariance_ = estimate_->T_base_device.covariance;
  verified_mm_ = wire::kUnknown;
  duration_ms_ = 1e3 * std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  changed();
}

void Procedure::check(std::int64_t now_ns) {
  const bool of_accepted = !found_anew();
  if (of_accepted && validity_ != bregma_wire_SCANNER_VALID) { // since the coils were ordered
    return fail("the registration is void, " + validity_text_, "confirm top to register anew");
  }
  auto &pose = of_accepted ? accepted_->T_base_device : estimate_->T_base_device;
  const geometry::Matrix6d &fitted = of_accepted ? accepted_->fitted_covariance : fitted_covariance_;
  const std::optional<double> table = of_accepted ? accepted_->table_mm : top_->table_mm();
  if (is_opposite_to_field(*tree_, now_ns)) { // says nothing about the registration
    return fail(kOppositeReadOut);
  }
  VerifyingCoils result =
      verify(*options_.frame, *tree_, {pose.pose, fitted}, of_accepted ? accepted_->coils : estimate_->coils,
             registration_options(*tree_, now_ns));
  std::string failure = std::move(result.found.failure);
  if (table_moved(table, tree_->table_mm())) {
    failure = "the table moved before the scan that verifies";
  }
  verifying_ = std::move(result.coils);
  verified_mm_ = result.found.rms_mm;
  if (failure.empty()) { // each verification replaces what the one before found
    pose.covariance = fitted;
    // Slices are taken with one read-out: what B0 has become since it was mapped displaces what they show.
    pose.covariance.bottomRightCorner<3, 3>() += result.found.unexplained + result.b0.second_moment;
    const double tre_95_mm = mri::predicted_95_mm(pose, options_.target_mm);
    (of_accepted ? accepted_->tre_95_mm : estimate_->tre_95_mm) = tre_95_mm;
    if (!(tre_95_mm <= options_.limit_mm)) {
      failure = "with what the coils that verify show, the predicted error at the target is " + mm(tre_95_mm) +
                ", limit " + mm(options_.limit_mm);
    }
  }
  if (of_accepted && !failure.empty()) {
    void_registration(bregma_wire_SCANNER_FRAME_MOVED, failure);
  } else if (!failure.empty()) { // what does not verify is not shown as found
    estimate_->verdict = mri::RegistrationVerdict::kInconsistent;
    estimate_->reason = failure;
  }
  if (!failure.empty()) {
    return fail(failure, "look for what moved or entered the bore, then confirm top to register anew");
  }
  const std::string found =
      mm(verified_mm_) + (result.b0.max_mm > kB0Changed_mm ? "; B0 has changed by up to " + mm(result.b0.max_mm) +
                                                                 " since it was mapped, as images of one read-out show"
                                                           : "");
  if (of_accepted) {
    return wait_for_operator(bregma_wire_SCANNER_STEP_DONE, "verified: " + found,
                             "confirm verify to check it again, or top to register anew");
  }
  wait_for_operator(bregma_wire_SCANNER_STEP_ACCEPT, "the robot is found and verified: " + found,
                    "accept the registration");
}

void Procedure::watch_table(const wire::ImageSlice &slice) {
  const auto stated = stated_table(slice);
  if (step_ == bregma_wire_SCANNER_STEP_ACCEPT && !busy() && found_anew() && table_moved(top_->table_mm(), stated)) {
    estimate_->verdict = mri::RegistrationVerdict::kInconsistent;
    estimate_->reason = "the table moved by " + mm(std::abs(*stated - *top_->table_mm())) + " since the scans";
    fail(estimate_->reason, "confirm top to register anew");
  }
  if (accepted_ && validity_ == bregma_wire_SCANNER_VALID && table_moved(accepted_->table_mm, stated)) {
    void_registration(bregma_wire_SCANNER_TABLE_MOVED, "the table moved by " +
                                                           mm(std::abs(*stated - *accepted_->table_mm)) +
                                                           " since the registration: register again");
  }
}

void Procedure::void_registration(wire::ScannerValidity validity, const std::string &text) {
  validity_ = validity;
  validity_text_ = text;
  changed();
}

ScannerPoseView Procedure::pose() const {
  ScannerPoseView out;
  (void)wire::set_name(out.scanner, options_.scanner);
  out.valid = accepted_ && validity_ == bregma_wire_SCANNER_VALID;
  if (out.valid) {
    out.T_base_scanner = wire::to_wire(accepted_->T_base_device.pose);
    put(accepted_->T_base_device.covariance, out.covariance);
  }
  return out;
}

void Procedure::fill(wire::ScannerRegistration &out, std::int64_t now_ns) const {
  out.step = step_;
  out.activity = activity_;
  wire::set_text(out.text, text_);
  wire::set_text(out.next, coils_fault_.empty() ? next_ : coils_fault_ + "; then: " + next_);
  if (phase_ == Phase::kWaiting || phase_ == Phase::kReceiving) {
    (void)wire::set_name(out.protocol, plan_[scan_].protocol);
    out.slices = series_ ? series_->received() : 0;
    out.slices_expected = series_ ? series_->expected() : plan_[scan_].slices;
  }
  out.T_base_scanner = out.accepted_T_base_scanner = wire::unknown_pose();
  put_unknown(out.covariance);
  put_unknown(out.accepted_covariance);
  out.fre_mm = out.fre_expected_mm = out.p_value = out.tre_95_mm = out.verified_mm = out.opme_mm = wire::kUnknown;
  out.change_mm = out.change_rad = out.accepted_tre_95_mm = wire::kUnknown;
  out.duration_ms = duration_ms_;
  out.revision = estimate_revision_;
  out.verdict = bregma_wire_SCANNER_VERDICT_NONE;
  if (estimate_) {
    out.verdict = verdict_of(estimate_->verdict);
    wire::set_text(out.reason, estimate_->reason.empty() && !estimate_->notes.empty() ? estimate_->notes.front()
                                                                                      : estimate_->reason);
  }
  if (estimate_ && (estimate_->verdict == mri::RegistrationVerdict::kFound ||
                    estimate_->verdict == mri::RegistrationVerdict::kInaccurate)) {
    out.T_base_scanner = wire::to_wire(estimate_->T_base_device.pose);
    put(estimate_->T_base_device.covariance, out.covariance);
    out.fre_mm = estimate_->fre_mm;
    out.fre_expected_mm = estimate_->fre_expected_mm;
    out.p_value = estimate_->p_value;
    out.tre_95_mm = estimate_->tre_95_mm;
    out.opme_mm = estimate_->opme_mm;
    if (accepted_) {
      const auto &before = accepted_->T_base_device.pose;
      const Eigen::Vector3d target = before.inverse() * options_.target_mm;
      out.change_mm = (estimate_->T_base_device.pose * target - options_.target_mm).norm();
      out.change_rad = geometry::angle_between(before.rotation(), estimate_->T_base_device.pose.rotation());
    }
  }
  out.verified_mm = verifying_.empty() ? wire::kUnknown : verified_mm_;
  fill_coils(out);

  out.validity = validity();
  if (accepted_) {
    wire::set_text(out.validity_text, validity_text_);
    out.accepted_revision = accepted_->revision;
    out.accepted_time_ns = accepted_->time_ns;
    out.accepted_tre_95_mm = accepted_->tre_95_mm;
    out.accepted_corrected = accepted_->corrected;
    if (validity_ == bregma_wire_SCANNER_VALID) {
      out.accepted_T_base_scanner = wire::to_wire(accepted_->T_base_device.pose);
      put(accepted_->T_base_device.covariance, out.accepted_covariance);
    }
  }

  out.field_status = !field_                  ? bregma_wire_FIELD_NONE
                     : field_is_valid(now_ns) ? bregma_wire_FIELD_VALID
                                              : bregma_wire_FIELD_EXPIRED;
  out.field_initial_mm = out.field_residual_mm = out.field_residual_max_mm = out.phantom_moved_mm = wire::kUnknown;
  if (field_) {
    (void)wire::set_name(out.field, std::string_view(field_->identity).substr(0, wire::kNameLength));
    out.field_made_ns = field_->made_ns;
    out.field_expires_ns = field_->expires_ns;
    out.field_points = field_->points;
    out.field_initial_mm = field_->initial_mm;
    out.field_residual_mm = field_->residual_mm;
    out.field_residual_max_mm = field_->residual_max_mm;
    out.phantom_moved_mm = field_->moved_mm;
  }
}

void Procedure::fill_coils(wire::ScannerRegistration &out) const {
  if (!options_.frame) {
    return;
  }
  const mri::CoilFrame &frame = *options_.frame;
  out.coil_count = static_cast<std::uint32_t>(std::min<std::size_t>(frame.coils.size(), bregma_wire_MAX_COILS));
  for (std::uint32_t i = 0; i < out.coil_count; ++i) {
    wire::CoilReport &coil = out.coils[i];
    (void)wire::set_name(coil.coil, std::string_view(frame.coils[i].name).substr(0, wire::kNameLength));
    coil.outcome = bregma_wire_COIL_IDLE;
    put_unknown(coil.scanner_mm);
    coil.sigma_mm = coil.residual_mm = wire::kUnknown;
  }
  const auto mark_on = [&](const std::optional<CoilScans> &scans) {
    if (scans && scans->finished()) {
      for (const int on : scans->scan().on) {
        out.coils[on].outcome = bregma_wire_COIL_NOT_SEEN;
      }
    }
  };
  mark_on(top_);
  mark_on(bottom_);
  mark_on(tree_);
  const auto put_found = [&](const mri::LocatedCoil &found, wire::CoilOutcome outcome) {
    if (found.coil < 0 || static_cast<std::uint32_t>(found.coil) >= out.coil_count) {
      return;
    }
    wire::CoilReport &coil = out.coils[found.coil];
    coil.outcome = outcome;
    put(found.position_mm, coil.scanner_mm);
    coil.sigma_mm = std::sqrt(found.covariance.trace() / 3.0);
    coil.residual_mm = found.residual_mm;
  };
  if (estimate_) {
    for (const mri::LocatedCoil &coil : estimate_->coils) {
      put_found(coil, coil.used ? bregma_wire_COIL_USED : bregma_wire_COIL_OUTLIER);
    }
  }
  for (const mri::LocatedCoil &coil : verifying_) {
    put_found(coil, bregma_wire_COIL_VERIFIES);
  }
}

} // namespace bregma::server
