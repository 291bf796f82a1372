#include "server/stages/pose_search/pose_search.hpp"

#include <algorithm>
#include <exception>
#include <string_view>
#include <vector>

namespace bregma::server {
namespace {

// Truncated and NUL-terminated.
template <std::size_t Size> void put_text(std::string_view text, std::array<char, Size> &out) noexcept {
  out = {};
  std::copy_n(text.begin(), std::min(text.size(), Size - 1), out.begin());
}

} // namespace

struct PoseSearch::Prepared {
  explicit Prepared(const LoadedCase &a_case)
      : field(a_case.scalp), registration(field, options(a_case), kMaxSearchSamples) {}

  static registration::GlobalOptions options(const LoadedCase &a_case) {
    const registration::RegistrationOptions &joint = a_case.estimator.options();
    registration::GlobalOptions out;
    out.sigma_mm = joint.surface_sigma_mm;
    out.model_sigma_mm = joint.surface_sigma_mm;
    out.correlation_length_mm = joint.correlation_length_mm;
    return out;
  }

  surface::SurfaceField field;
  registration::GlobalRegistration registration;
};

PoseSearch::PoseSearch() = default;
PoseSearch::~PoseSearch() = default;

void PoseSearch::handle(const CaseChanged &change) {
  prepared_.reset();
  case_ = change.loaded;
  generation_ = change.generation;
}

std::optional<PoseSearchAnswer> PoseSearch::answer(const PoseSearchRequest &request) noexcept {
  if (case_ == nullptr || request.generation != generation_) {
    return std::nullopt;
  }
  PoseSearchAnswer out{};
  out.generation = request.generation;
  out.revision = request.revision;
  try {
    search(request, out);
  } catch (const std::exception &error) {
    put_text(std::string_view(error.what()), out.text);
  }
  return out;
}

void PoseSearch::search(const PoseSearchRequest &request, PoseSearchAnswer &out) {
  if (!prepared_) {
    prepared_ = std::make_unique<Prepared>(*case_);
  }
  std::vector<Eigen::Vector3d> samples;
  samples.reserve(request.count);
  for (std::size_t i = 0; i < request.count; ++i) {
    samples.emplace_back(request.reference_mm[i].data());
  }
  const registration::GlobalResult &result = prepared_->registration.locate(samples);
  const Eigen::Quaterniond &rotation = result.T_target_source.rotation();
  out.rotation_wxyz = {rotation.w(), rotation.x(), rotation.y(), rotation.z()};
  Eigen::Vector3d::Map(out.translation_mm.data()) = result.T_target_source.translation();
  put_text(registration::describe(result), out.text);
  out.found = result.verdict == registration::Verdict::kFound;
}

} // namespace bregma::server
