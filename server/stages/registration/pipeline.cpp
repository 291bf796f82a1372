#include "server/stages/registration/pipeline.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <utility>

#include "server/stages/wire_values.hpp"

namespace bregma::server {
namespace {

using registration::Refusal;

wire::RefusalReason to_wire(Refusal refusal) noexcept {
  switch (refusal) {
  case Refusal::kNone:
    return bregma_wire_REFUSAL_NONE;
  case Refusal::kTooFewFiducials:
    return bregma_wire_REFUSAL_TOO_FEW_FIDUCIALS;
  case Refusal::kCollinearFiducials:
    return bregma_wire_REFUSAL_COLLINEAR_FIDUCIALS;
  case Refusal::kContradictingFiducial:
    return bregma_wire_REFUSAL_CONTRADICTING_FIDUCIAL;
  case Refusal::kDirectionNotFixed:
    return bregma_wire_REFUSAL_DIRECTION_NOT_FIXED;
  case Refusal::kFreTooLarge:
    return bregma_wire_REFUSAL_FRE_TOO_LARGE;
  case Refusal::kNotConverged:
    break;
  }
  return bregma_wire_REFUSAL_NOT_CONVERGED;
}

} // namespace

RegistrationPipeline::RegistrationPipeline() {
  surface_.reserve(kMaxSurfaceSamples);
  clear();
}

void RegistrationPipeline::clear() noexcept {
  sample_count_ = 0;
  surface_.clear();
  surface_common_mm2_.setZero();
  previous_.reset();
  located_.reset();
  search_text_ = {};
  searched_count_ = 0;
  const RegistrationEstimate old = state_;
  state_ = {};
  copy_name(state_.reference, old.reference);
  state_.status = bregma_wire_REGISTRATION_NONE;
  state_.reason = bregma_wire_REFUSAL_NONE;
  state_.T_image_reference = state_.accepted_T_image_reference = wire::unknown_pose();
  put_unknown(state_.covariance);
  put_unknown(state_.accepted_covariance);
  state_.fre_mm = state_.fre_expected_mm = state_.surface_rms_mm = state_.duration_ms = wire::kUnknown;
  report_ = {};
  copy_name(report_.reference, state_.reference);
  changed_ = false;
}

void RegistrationPipeline::handle(const RegistrationInput &input) noexcept {
  std::visit([this](const auto &content) noexcept { on(content); }, input);
}

void RegistrationPipeline::end_states(std::int64_t now_ns) noexcept {
  clear();
  reset_ = false;
  state_.time_ns = now_ns;
  state_.ended = report_.ended = true;
}

void RegistrationPipeline::on(const CaseChanged &change) noexcept {
  case_ = change.loaded;
  generation_ = change.generation;
  searching_ = false; // a running search belongs to another case
  revision_ = 0;
  target_count_ = 0;
  const casefile::ToolModel *reference = case_ != nullptr ? case_->data->reference() : nullptr;
  (void)wire::set_name(state_.reference, reference != nullptr ? std::string_view(reference->name) : std::string_view());
  clear();
  if (case_ != nullptr) {
    for (const casefile::NamedPoint &target : case_->data->targets) {
      if (target_count_ < targets_.size()) {
        targets_[target_count_++] = target.position_mm;
      }
    }
  }
}

void RegistrationPipeline::on(const RegistrationMessage &message) noexcept {
  struct Visitor {
    RegistrationPipeline &self;
    void operator()(const SessionChanged &) const noexcept {}
    void operator()(const FiducialSample &sample) const noexcept {
      self.put(sample);
      self.revision_ = sample.revision;
      self.changed_ = true;
    }
    void operator()(const FiducialRemoved &removed) const noexcept {
      self.remove(removed.point);
      self.revision_ = removed.revision;
      self.changed_ = true;
    }
    void operator()(const SurfaceSample &sample) const noexcept {
      if (self.surface_.size() < self.surface_.capacity()) {
        self.surface_.push_back({vector_of(sample.position_mm), matrix_of(sample.covariance_mm2),
                                 vector_of(sample.towards_sensor), vector_of(sample.across)});
        self.surface_common_mm2_ += matrix_of(sample.common_mm2);
      }
      self.revision_ = sample.revision;
      self.changed_ = true;
    }
    void operator()(const RegistrationAccepted &accepted) const noexcept {
      self.state_.accepted_revision = accepted.revision;
      self.state_.accepted_T_image_reference = accepted.T_image_reference;
      std::copy(accepted.covariance.begin(), accepted.covariance.end(), self.state_.accepted_covariance);
      self.changed_ = true; // the status changes
    }
    void operator()(const RegistrationReset &reset) const noexcept {
      self.clear();
      self.reset_ = true;
      self.revision_ = reset.revision;
      self.state_.revision = reset.revision;
    }
  };
  std::visit(Visitor{*this}, message);
}

void RegistrationPipeline::put(const FiducialSample &sample) noexcept {
  for (std::size_t i = 0; i < sample_count_; ++i) {
    if (same(samples_[i].point, sample.point)) {
      samples_[i] = sample;
      return;
    }
  }
  if (sample_count_ < samples_.size()) {
    samples_[sample_count_++] = sample;
  }
}

void RegistrationPipeline::remove(const wire::Name &point) noexcept {
  for (std::size_t i = 0; i < sample_count_; ++i) {
    if (same(samples_[i].point, point)) {
      samples_[i] = samples_[--sample_count_];
      return;
    }
  }
}

void RegistrationPipeline::step(std::int64_t now_ns) noexcept {
  report_changed_ = std::exchange(reset_, false);
  state_.time_ns = now_ns;
  if (changed_ && case_ != nullptr) {
    const auto began = std::chrono::steady_clock::now();
    estimate();
    state_.duration_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - began).count();
    changed_ = false;
    report_changed_ = true;
  }
}

const PoseSearchRequest *RegistrationPipeline::wanted_search() noexcept {
  const bool needed = case_ != nullptr && sample_count_ < 3 && !located_ && surface_.size() >= kMinSearchSamples;
  // After an unsuccessful search, another one needs 10 % more skin samples.
  if (!needed || searching_ || 10 * surface_.size() < 11 * searched_count_) {
    return nullptr;
  }
  search_.generation = generation_;
  search_.revision = revision_;
  search_.count = std::min(surface_.size(), kMaxSearchSamples);
  for (std::size_t i = 0; i < search_.count; ++i) {
    const auto &sample = surface_[i * surface_.size() / search_.count];
    Vector3d::Map(search_.reference_mm[i].data()) = sample.reference_mm;
  }
  searched_count_ = surface_.size();
  searching_ = true;
  return &search_;
}

void RegistrationPipeline::on(const PoseSearchAnswer &answer) noexcept {
  searching_ = false;
  // For another case, or for a registration that was restarted since.
  if (answer.generation != generation_ || surface_.size() < searched_count_ || searched_count_ == 0) {
    return;
  }
  if (answer.found) {
    located_ = {Eigen::Quaterniond(answer.rotation_wxyz[0], answer.rotation_wxyz[1], answer.rotation_wxyz[2],
                                   answer.rotation_wxyz[3]),
                Vector3d::Map(answer.translation_mm.data())};
  }
  search_text_ = answer.text;
  changed_ = true;
}

void RegistrationPipeline::estimate() noexcept {
  const casefile::Limits &limits = case_->data->limits;
  const Matrix3d placement = Matrix3d::Identity() * limits.fle_touch_mm * limits.fle_touch_mm;
  const Matrix3d planning = Matrix3d::Identity() * limits.fle_image_mm * limits.fle_image_mm;
  for (std::size_t i = 0; i < sample_count_; ++i) {
    const casefile::NamedPoint *planned = case_->data->fiducial(wire::view(samples_[i].point));
    // The session accepts samples only of the case's fiducials.
    observations_[i] = {vector_of(samples_[i].position_mm), matrix_of(samples_[i].covariance_mm2) + placement,
                        planned != nullptr ? planned->position_mm : Vector3d::Constant(wire::kUnknown), planning};
  }
  const std::span<const registration::FiducialObservation> fiducials(observations_.data(), sample_count_);
  const std::span<const Vector3d> targets(targets_.data(), target_count_);
  const auto *start = previous_ ? &*previous_ : nullptr;
  const bool by_skin_alone = sample_count_ < 3 && located_.has_value();
  const auto &result = by_skin_alone ? case_->estimator.estimate_located(fiducials, surface_, targets,
                                                                         start != nullptr ? *start : *located_)
                                     : case_->estimator.estimate(fiducials, surface_, targets, start);
  // A refused estimate is not used as a start, because it may be wrong.
  if (result.refusal == Refusal::kNone) {
    previous_ = result.T_image_reference;
  } else {
    previous_.reset();
  }
  show(result);
  show_fiducials(result);
}

// A displacement of all samples by d in Reference displaces the estimate by -R d in Image, wherever a target lies. Its
// mean over the samples is taken: of a scan beside touched fiducials these reduce its part, which is not counted. The
// tracker's turn against the arm is common too: a turn of all samples about their middle.
Matrix6d RegistrationPipeline::with_common(const registration::RegistrationResult &result) const noexcept {
  Matrix6d out = result.covariance;
  Matrix3d common = surface_common_mm2_;
  Vector3d middle = Vector3d::Zero();
  for (const auto &sample : surface_) {
    middle += sample.reference_mm;
  }
  std::size_t placed_by_arm = surface_common_mm2_.isZero() ? 0 : surface_.size();
  for (std::size_t i = 0; i < sample_count_; ++i) {
    const Matrix3d of_touch = matrix_of(samples_[i].common_mm2);
    common += of_touch;
    middle += vector_of(samples_[i].position_mm);
    placed_by_arm += of_touch.isZero() ? 0 : 1;
  }
  if (placed_by_arm == 0) {
    return out;
  }
  const Matrix3d R = result.T_image_reference.rotation_matrix();
  out.bottomRightCorner<3, 3>() += R * common * R.transpose() / static_cast<double>(placed_by_arm);
  if (const casefile::HandEyeModel *hand_eye = case_->data->hand_eye()) {
    middle /= static_cast<double>(surface_.size() + sample_count_);
    Matrix6d turn = Matrix6d::Zero(); // about an axis that differs with the place of the patient: the trace bounds all
    turn.topLeftCorner<3, 3>().diagonal().setConstant(
        hand_eye->T_base_tracker.covariance.topLeftCorner<3, 3>().trace());
    Matrix6d about_origin = Matrix6d::Identity();
    about_origin.bottomLeftCorner<3, 3>() = geometry::skew(result.T_image_reference * middle);
    out += about_origin * turn * about_origin.transpose();
  }
  return out;
}

void RegistrationPipeline::show(const registration::RegistrationResult &result) noexcept {
  state_.revision = revision_;
  state_.fiducial_count = static_cast<std::uint32_t>(sample_count_);
  state_.surface_count = static_cast<std::uint32_t>(surface_.size());
  state_.reason = to_wire(result.refusal);
  const bool refused = result.refusal != Refusal::kNone;
  const bool accepted = state_.accepted_revision != 0 && state_.accepted_revision == revision_;
  if (sample_count_ == 0 && surface_.empty()) {
    state_.status = bregma_wire_REGISTRATION_NONE;
  } else if (refused) {
    state_.status = bregma_wire_REGISTRATION_REFUSED;
  } else {
    state_.status = accepted ? bregma_wire_REGISTRATION_ACCEPTED : bregma_wire_REGISTRATION_CANDIDATE;
  }
  const std::string_view suspect =
      result.suspect >= 0 ? wire::view(samples_[static_cast<std::size_t>(result.suspect)].point) : std::string_view();
  const std::string_view target =
      result.worst_target >= 0
          ? std::string_view(case_->data->targets[static_cast<std::size_t>(result.worst_target)].name)
          : std::string_view("the head's centre");
  (void)wire::set_name(state_.subject, suspect);
  std::array<char, 160> suspects{};
  list_suspects(result, suspects);
  registration::describe(result, case_->estimator.options(), suspects.data(), target, state_.text);
  if (result.refusal == Refusal::kTooFewFiducials && search_text_[0] != '\0') {
    wire::set_text(state_.text, search_text_.data());
  }
  state_.excess_mm = array_of(result.excess_mm);
  if (refused) {
    state_.T_image_reference = wire::unknown_pose();
    put_unknown(state_.covariance);
  } else {
    registration::describe_excess(result, case_->estimator.options(), state_.text);
    state_.T_image_reference = wire::to_wire(result.T_image_reference);
    server::put(with_common(result), state_.covariance);
  }
  state_.fre_mm = result.has_estimate ? result.fre_mm : wire::kUnknown;
  state_.fre_expected_mm = result.has_estimate ? result.fre_expected_mm : wire::kUnknown;
  state_.surface_rms_mm = result.has_estimate && !surface_.empty() ? result.surface_rms_mm : wire::kUnknown;
}

void RegistrationPipeline::list_suspects(const registration::RegistrationResult &result,
                                         std::span<char> out) const noexcept {
  std::size_t length = 0;
  for (std::size_t i = 0; i < sample_count_; ++i) {
    if (result.suspects[i] && length + 1 < out.size()) {
      const std::string_view name = wire::view(samples_[i].point);
      const int added = std::snprintf(out.data() + length, out.size() - length, "%s%.*s", length > 0 ? ", " : "",
                                      static_cast<int>(name.size()), name.data());
      length += static_cast<std::size_t>(std::max(added, 0));
    }
  }
}

void RegistrationPipeline::show_fiducials(const registration::RegistrationResult &result) noexcept {
  report_.revision = revision_;
  report_.count = static_cast<std::uint32_t>(sample_count_);
  for (std::size_t i = 0; i < sample_count_; ++i) {
    wire::FiducialResidual &out = report_.fiducials[i];
    out = {};
    copy_name(out.fiducial, samples_[i].point);
    if (result.has_estimate) {
      const registration::FiducialFit &fit = result.fiducials[i];
      server::put(fit.residual_mm, out.residual_mm);
      out.norm_mm = fit.norm_mm;
      out.leave_one_out_mm = fit.leave_one_out_mm;
      out.p_value = fit.p_value;
    } else {
      put_unknown(out.residual_mm);
      out.norm_mm = out.leave_one_out_mm = out.p_value = wire::kUnknown;
    }
    out.suspect = result.suspects[i];
  }
}

} // namespace bregma::server
