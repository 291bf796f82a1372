#include "clients/cli/report/tip_analysis.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "algorithms/geometry/rigid3.hpp"
#include "algorithms/geometry/unknown.hpp"
#include "idl/names.hpp"

namespace bregma::cli::report {
namespace {

using Eigen::Vector3d;
namespace frame = geometry::frame;
using ImagePose = geometry::Rigid3<frame::Image, frame::Reference>;

// A restarted tracker restarts its frame numbers, so a number alone does not identify a frame.
constexpr std::int64_t kSameFrame_ns = 1'000'000'000;

// The nearest structure is always reported, others only if the tip came within this distance.
constexpr double kApproach_mm = 50.0;

struct TrueTip {
  std::int64_t time_ns;
  std::uint32_t tool;
  Vector3d tip_mm;
  ImagePose T_image_reference;
};

class Tools {
public:
  explicit Tools(std::vector<std::string> &names) : names_(names) {}
  std::uint32_t index(const wire::Name &name) {
    const auto found = std::find(names_.begin(), names_.end(), wire::view(name));
    if (found == names_.end()) {
      names_.push_back(wire::text(name));
      return static_cast<std::uint32_t>(names_.size() - 1);
    }
    return static_cast<std::uint32_t>(found - names_.begin());
  }

private:
  std::vector<std::string> &names_;
};

class TruthIndex {
public:
  base::Result<void> read(const casefile::SessionReader &reader, Tools &tools) {
    return reader
        .each<wire::SimulatedTruth>([&](const wire::SimulatedTruth &truth, std::int64_t) {
          const auto T_image_reference = wire::from_wire<frame::Image, frame::Reference>(truth.T_image_reference);
          for (std::size_t i = 0; i < std::min<std::size_t>(truth.tool_count, std::size(truth.tools)); ++i) {
            const auto &tool = truth.tools[i];
            const Vector3d tip(tool.T_image_tip.translation_mm);
            if (tip.allFinite()) { // that of a scanner has none
              seed_ = truth.seeded ? std::optional<std::uint64_t>(truth.seed) : seed_;
              tips_.emplace(truth.frame, TrueTip{truth.time_ns, tools.index(tool.tool), tip, T_image_reference});
            }
          }
        })
        .map([](std::size_t) {});
  }
  [[nodiscard]] bool empty() const { return tips_.empty(); }
  [[nodiscard]] std::optional<std::uint64_t> seed() const { return seed_; } // of the simulated run, if it is stated

  // The frame with this number that is nearest in time.
  [[nodiscard]] const TrueTip *find(std::uint64_t frame_number, std::uint32_t tool, std::int64_t time_ns) const {
    const TrueTip *best = nullptr;
    const auto [first, last] = tips_.equal_range(frame_number);
    for (auto it = first; it != last; ++it) {
      const std::int64_t gap = std::abs(it->second.time_ns - time_ns);
      if (it->second.tool == tool && gap < kSameFrame_ns &&
          (best == nullptr || gap < std::abs(best->time_ns - time_ns))) {
        best = &it->second;
      }
    }
    return best;
  }

private:
  std::unordered_multimap<std::uint64_t, TrueTip> tips_;
  std::optional<std::uint64_t> seed_;
};

// The registration that was valid at a time.
class AcceptedRegistrations {
public:
  base::Result<void> read(const casefile::SessionReader &reader) {
    return reader
        .each<wire::RegistrationState>([&](const wire::RegistrationState &state, std::int64_t time_ns) {
          const bool known =
              state.accepted_revision > 0 && std::isfinite(state.accepted_T_image_reference.rotation_wxyz[0]);
          accepted_[time_ns] =
              known ? std::optional(wire::from_wire<frame::Image, frame::Reference>(state.accepted_T_image_reference))
                    : std::nullopt;
        })
        .map([](std::size_t) {});
  }
  [[nodiscard]] std::optional<ImagePose> at(std::int64_t time_ns) const {
    const auto after = accepted_.upper_bound(time_ns);
    return after == accepted_.begin() ? std::nullopt : std::prev(after)->second;
  }

private:
  std::map<std::int64_t, std::optional<ImagePose>> accepted_;
};

// Squared length of an error vector in units of the semi-axes.
double in_semi_axes(const wire::Ellipsoid &region, const Vector3d &error_mm) {
  double sum = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vector3d axis(region.axes + 3 * i);
    sum += std::pow(axis.dot(error_mm) / region.semi_axes_mm[i], 2);
  }
  return sum;
}

bool is_shown(const wire::NavigationState &state) {
  return state.status == bregma_wire_POSE_LIVE || state.status == bregma_wire_POSE_UNVERIFIED;
}

bool follows_plan(const wire::NavigationState &state) {
  return state.session == bregma_wire_SESSION_NAVIGATING && state.status == bregma_wire_POSE_LIVE &&
         !wire::view(state.trajectory).empty();
}

double milliseconds(std::int64_t duration_ns) { return static_cast<double>(duration_ns) * 1e-6; }

class TipPass {
public:
  TipPass(SessionAnalysis &out, Tools &tools, const TruthIndex &truth, const AcceptedRegistrations &accepted)
      : out_(out), tools_(tools), truth_(truth), accepted_(accepted) {}

  void take(const wire::NavigationState &state) {
    const std::uint32_t tool = tools_.index(state.tool);
    auto &last = last_[tool];
    // Every state counts for the rate, but only the first state per frame counts for latency and errors.
    if (!wire::view(state.trajectory).empty()) {
      count_rate(state, last);
    }
    const bool repeated = last.seen && last.frame == state.frame && last.acquired_ns == state.acquired_time_ns;
    last = {true, state.frame, state.acquired_time_ns, state.published_time_ns,
            state.session == bregma_wire_SESSION_NAVIGATING && !wire::view(state.trajectory).empty()};
    if (repeated || state.acquired_time_ns <= 0) {
      return;
    }
    exposure_to_published_.push_back(milliseconds(state.published_time_ns - state.acquired_time_ns));
    if (state.frame_sent_time_ns > 0) {
      sent_to_published_.push_back(milliseconds(state.published_time_ns - state.frame_sent_time_ns));
    }
    if (is_shown(state)) {
      take_tip(state, tool);
    }
  }

  void finish() {
    out_.exposure_to_published_ms = distribution_of(std::move(exposure_to_published_));
    out_.sent_to_published_ms = distribution_of(std::move(sent_to_published_));
    out_.navigation_rate_hz = navigated_ns_ > 0
                                  ? static_cast<double>(navigated_states_) / (static_cast<double>(navigated_ns_) * 1e-9)
                                  : geometry::kUnknown;
    for (auto &[name, approach] : approaches_) {
      out_.approaches.push_back(std::move(approach));
    }
    std::stable_sort(out_.approaches.begin(), out_.approaches.end(),
                     [](const Approach &a, const Approach &b) { return a.shown_mm < b.shown_mm; });
    while (out_.approaches.size() > 1 && out_.approaches.back().shown_mm > kApproach_mm) {
      out_.approaches.pop_back();
    }
    if (at_target_.samples > 0) {
      at_target_.shown_distance_mm = distribution_of(std::move(shown_distance_)).percentile(0.5);
      at_target_.lateral_mm = distribution_of(std::move(lateral_)).percentile(0.5);
      at_target_.predicted_rms_mm = distribution_of(std::move(predicted_)).percentile(0.5);
      at_target_.true_error_mm = distribution_of(std::move(true_error_));
      if (ellipsoid_known_ > 0) {
        at_target_.inside_share = static_cast<double>(ellipsoid_inside_) / static_cast<double>(ellipsoid_known_);
        at_target_.inside = 2 * ellipsoid_inside_ > ellipsoid_known_;
      }
      out_.at_target = std::move(at_target_);
    }
  }

private:
  struct Last {
    bool seen = false;
    std::uint64_t frame = 0;
    std::int64_t acquired_ns = 0;
    std::int64_t published_ns = 0;
    bool navigating = false;
  };

  void count_rate(const wire::NavigationState &state, const Last &last) {
    if (state.session == bregma_wire_SESSION_NAVIGATING) {
      out_.navigated = true;
      if (last.navigating) {
        navigated_ns_ += state.published_time_ns - last.published_ns;
        ++navigated_states_;
      }
    }
  }

  void take_tip(const wire::NavigationState &state, std::uint32_t tool) {
    TipSample sample;
    sample.time_ns = state.published_time_ns;
    sample.tool = tool;
    sample.predicted_rms_mm = state.tre_rms_mm;
    const TrueTip *truth = truth_.find(state.frame, tool, state.acquired_time_ns);
    if (truth != nullptr) {
      const Vector3d error = Vector3d(state.T_image_tip.translation_mm) - truth->tip_mm;
      sample.true_error_mm = error.norm();
      sample.ellipsoid = in_semi_axes(state.tre_95, error);
    }
    if (follows_plan(state)) {
      out_.path.push_back({state.published_time_ns, wire::text(state.trajectory),
                           Vector3d(state.T_image_tip.translation_mm), state.remaining_depth_mm,
                           state.lateral_deviation_mm});
      take_approach(state, sample.true_error_mm);
      sample.at_target = std::abs(state.remaining_depth_mm) <= kAtTargetDepth_mm &&
                         state.distance_to_target_mm <= kAtTargetDistance_mm;
      if (sample.at_target) {
        take_at_target(state, sample, truth);
      }
    }
    out_.tips.push_back(sample);
  }

  void take_approach(const wire::NavigationState &state, double true_error_mm) {
    const std::string name = wire::text(state.nearest_structure);
    if (name.empty() || !std::isfinite(state.nearest_structure_mm)) {
      return;
    }
    auto [entry, is_new] = approaches_.try_emplace(name);
    Approach &approach = entry->second;
    if (is_new || state.nearest_structure_mm < approach.shown_mm) {
      approach.structure = name;
      approach.tool = wire::text(state.tool);
      approach.time_ns = state.published_time_ns;
      approach.shown_mm = state.nearest_structure_mm;
    }
    // A distance changes by at most the displacement of the tip.
    const double at_least = std::max(0.0, state.nearest_structure_mm - true_error_mm);
    if (std::isfinite(true_error_mm) &&
        (!std::isfinite(approach.true_at_least_mm) || at_least < approach.true_at_least_mm)) {
      approach.true_at_least_mm = at_least;
    }
  }

  void take_at_target(const wire::NavigationState &state, const TipSample &sample, const TrueTip *truth) {
    ++at_target_.samples;
    at_target_.tool = wire::text(state.tool);
    at_target_.trajectory = wire::text(state.trajectory);
    shown_distance_.push_back(state.distance_to_target_mm);
    lateral_.push_back(state.lateral_deviation_mm);
    predicted_.push_back(sample.predicted_rms_mm);
    true_error_.push_back(sample.true_error_mm);
    if (std::isfinite(sample.ellipsoid)) {
      ++ellipsoid_known_;
      ellipsoid_inside_ += sample.ellipsoid <= 1.0 ? 1 : 0;
    }
    if (const auto T = accepted_.at(state.published_time_ns); T && truth != nullptr) {
      const Vector3d registered = *T * (truth->T_image_reference.inverse() * truth->tip_mm);
      at_target_.registration_error_mm = (registered - truth->tip_mm).norm();
    }
  }

  SessionAnalysis &out_;
  Tools &tools_;
  const TruthIndex &truth_;
  const AcceptedRegistrations &accepted_;
  std::map<std::uint32_t, Last> last_;
  std::vector<double> exposure_to_published_;
  std::vector<double> sent_to_published_;
  std::int64_t navigated_ns_ = 0;
  std::uint64_t navigated_states_ = 0;
  std::map<std::string, Approach> approaches_;
  AtTarget at_target_;
  std::vector<double> shown_distance_;
  std::vector<double> lateral_;
  std::vector<double> predicted_;
  std::vector<double> true_error_;
  std::size_t ellipsoid_known_ = 0;
  std::size_t ellipsoid_inside_ = 0;
};

} // namespace

Distribution distribution_of(std::vector<double> values) {
  std::erase_if(values, [](double value) { return !std::isfinite(value); });
  std::sort(values.begin(), values.end());
  return {std::move(values)};
}

double Distribution::percentile(double fraction) const {
  if (sorted.empty()) {
    return geometry::kUnknown;
  }
  const double rank = std::ceil(fraction * static_cast<double>(sorted.size()));
  const auto index = static_cast<std::size_t>(std::max(rank, 1.0)) - 1;
  return sorted[std::min(index, sorted.size() - 1)];
}

base::Result<void> analyse_tips(const casefile::SessionReader &reader, SessionAnalysis &out) {
  Tools tools(out.tools);
  TruthIndex truth;
  AcceptedRegistrations accepted;
  if (auto read = truth.read(reader, tools).and_then([&] { return accepted.read(reader); }); !read) {
    return read;
  }
  out.has_truth = !truth.empty();
  out.seed = truth.seed();
  TipPass pass(out, tools, truth, accepted);
  auto read =
      reader.each<wire::NavigationState>([&](const wire::NavigationState &state, std::int64_t) { pass.take(state); });
  if (!read) {
    return tl::unexpected(read.error());
  }
  pass.finish();
  return {};
}

} // namespace bregma::cli::report
