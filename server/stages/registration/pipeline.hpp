// The registration pipeline: stores the samples from the session and re-estimates the pose of the head when they have
// changed, starting from the last estimate. The method is algorithms/registration/registration.hpp.
//
// It only proposes; the operator accepts (RegistrationAccepted). The accepted registration does not change with later
// estimates, bit for bit. One thread; a step does not allocate, throw, lock or log.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include "server/session/messages.hpp"
#include "server/stages/loaded_case.hpp"
#include "server/stages/pose_search/pose_search.hpp"

namespace bregma::server {

using RegistrationInput = std::variant<CaseChanged, RegistrationMessage>;

inline constexpr std::size_t kMaxSurfaceSamples = kMaxSearchSamples; // maximal number of samples of a trace

class RegistrationPipeline {
public:
  RegistrationPipeline();

  void handle(const RegistrationInput &input) noexcept;
  void on(const PoseSearchAnswer &answer) noexcept;
  void step(std::int64_t now_ns) noexcept;

  // After a step: the request for a search, if there are too few fiducials and no start pose; null if there is none or
  // a search is running.
  [[nodiscard]] const PoseSearchRequest *wanted_search() noexcept;

  // State after the last step. Without a case the reference has no name and the status is REGISTRATION_NONE.
  [[nodiscard]] const RegistrationEstimate &state() const noexcept { return state_; }
  [[nodiscard]] const wire::FiducialReport &fiducials() const noexcept { return report_; }
  // True if the last step made a new estimate or none is left: the fiducial report has changed.
  [[nodiscard]] bool report_changed() const noexcept { return report_changed_; }
  // Turns state() and fiducials() into the last ones of their instances: the case is closed or replaced.
  void end_states(std::int64_t now_ns) noexcept;

private:
  void on(const CaseChanged &change) noexcept;
  void on(const RegistrationMessage &message) noexcept;
  void clear() noexcept;
  void put(const FiducialSample &sample) noexcept;
  void remove(const wire::Name &point) noexcept;
  void estimate() noexcept;
  void show(const registration::RegistrationResult &result) noexcept;
  // The covariance of the estimate with the error that all samples of a scan have in common.
  [[nodiscard]] geometry::Matrix6d with_common(const registration::RegistrationResult &result) const noexcept;
  // Their names, NUL-terminated and truncated to the size of out.
  void list_suspects(const registration::RegistrationResult &result, std::span<char> out) const noexcept;
  void show_fiducials(const registration::RegistrationResult &result) noexcept;

  LoadedCase *case_ = nullptr;
  std::uint64_t generation_ = 0;
  std::uint64_t revision_ = 0;
  bool changed_ = false;
  bool reset_ = false;          // since the last step
  bool report_changed_ = false; // by the last step

  std::array<FiducialSample, registration::kMaxFiducials> samples_{};
  std::size_t sample_count_ = 0;
  std::array<registration::FiducialObservation, registration::kMaxFiducials> observations_{};
  std::vector<registration::SurfaceSample> surface_;                   // reserved once
  geometry::Matrix3d surface_common_mm2_ = geometry::Matrix3d::Zero(); // sum of SurfaceSample::common_mm2
  std::array<Eigen::Vector3d, bregma_wire_MAX_TARGETS> targets_;
  std::size_t target_count_ = 0;
  std::optional<registration::ImageFromReference> previous_;

  // The pose found from the skin alone; the text of the last unsuccessful search; its number of samples.
  std::optional<registration::ImageFromReference> located_;
  std::array<char, 256> search_text_{};
  std::size_t searched_count_ = 0;
  bool searching_ = false;
  PoseSearchRequest search_;

  RegistrationEstimate state_{};
  wire::FiducialReport report_{};
};

} // namespace bregma::server
