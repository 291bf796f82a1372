#include "clients/cli/report/tissue_analysis.hpp"

#include <algorithm>
#include <cmath>

#include "algorithms/geometry/unknown.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/names.hpp"

namespace bregma::cli::report {
namespace {

TissueSample sample_of(const wire::DeformationState &state) {
  TissueSample out;
  out.time_ns = state.time_ns;
  out.phase = std::string(phase_label(state.phase));
  out.status = std::string(deformation_label(state.status));
  out.depth_mm = state.depth_mm;
  out.tip_force_N = state.tip_force_N;
  out.shaft_force_N = state.shaft_force_N;
  out.measured_force_N = state.measured_force_N;
  out.von_mises_Pa = state.von_mises_Pa;
  out.motion_mm = (Eigen::Vector3d::Map(state.displaced_mm) - Eigen::Vector3d::Map(state.imaged_mm)).norm();
  out.error_bound_mm = state.error_bound_mm;
  return out;
}

// The probe stands still where its depth changes by less than this for at least that time.
constexpr double kStill_mm = 0.5;
constexpr std::int64_t kStill_ns = 1'000'000'000;

void mark_still(std::vector<TissueSample> &samples) {
  for (std::size_t from = 0; from < samples.size();) {
    double least = samples[from].depth_mm;
    double most = least;
    std::size_t end = from + 1;
    for (; end < samples.size(); ++end) {
      least = std::min(least, samples[end].depth_mm);
      most = std::max(most, samples[end].depth_mm);
      if (!(most - least < kStill_mm)) {
        break;
      }
    }
    if (samples[end - 1].time_ns - samples[from].time_ns < kStill_ns) {
      ++from;
      continue;
    }
    for (; from < end; ++from) {
      samples[from].still = true;
    }
  }
}

void follow(const wire::DeformationState &state, FollowedLandmark &landmark) {
  const TissueSample sample = sample_of(state);
  landmark.landmark = wire::text(state.point);
  if (sample.motion_mm > landmark.largest_motion_mm || std::isnan(landmark.largest_motion_mm)) {
    landmark.largest_motion_mm = sample.motion_mm;
    landmark.error_bound_mm = sample.error_bound_mm;
  }
}

} // namespace

base::Result<void> analyse_tissue(const casefile::SessionReader &reader, SessionAnalysis &out) {
  std::map<std::string, InsertionAnalysis> by_target;
  std::map<std::string, FollowedLandmark> landmarks;
  std::map<std::string, std::uint32_t> ruptures_before;
  const auto read = reader.each<wire::DeformationState>([&](const wire::DeformationState &state, std::int64_t) {
    if (state.status == bregma_wire_DEFORMATION_NO_MODEL) {
      return;
    }
    const std::string target = wire::text(state.point);
    const bool in_tissue = state.phase > bregma_wire_PROBE_OUTSIDE;
    if (state.kind == bregma_wire_FOLLOWED_LANDMARK) {
      if (in_tissue) {
        follow(state, landmarks[target]);
      }
      return;
    }
    const std::uint32_t before = ruptures_before.try_emplace(target, state.ruptures).first->second;
    if (!in_tissue) {
      return;
    }
    InsertionAnalysis &insertion = by_target[target];
    insertion.target = target;
    insertion.elements = state.elements;
    insertion.stiffness_scale = state.stiffness_scale;
    if (insertion.ruptures == 0 && state.ruptures > before) {
      insertion.rupture_force_N = state.rupture_force_N;
      insertion.rupture_depth_mm = insertion.samples.empty() ? geometry::kUnknown : insertion.samples.back().depth_mm;
    }
    insertion.ruptures = state.ruptures - std::min(state.ruptures, before);
    insertion.samples.push_back(sample_of(state));
    insertion.largest_motion_mm =
        std::fmax(insertion.largest_motion_mm, insertion.samples.back().motion_mm); // fmax ignores NaN
    ++insertion.states[insertion.samples.back().status];
    if (state.reason != bregma_wire_DEFORMATION_REASON_NONE) {
      ++insertion.reasons[std::string(deformation_reason_label(state.reason))];
    }
  });
  if (!read) {
    return tl::unexpected(read.error());
  }
  for (auto &[target, insertion] : by_target) {
    if (!out.insertion || insertion.largest_motion_mm > out.insertion->largest_motion_mm) {
      out.insertion = std::move(insertion);
    }
  }
  if (out.insertion) {
    mark_still(out.insertion->samples);
  }
  for (auto &[name, landmark] : landmarks) {
    if (out.insertion) {
      out.insertion->landmarks.push_back(std::move(landmark));
    }
  }
  return {};
}

} // namespace bregma::cli::report
