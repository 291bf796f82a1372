#include "clients/cli/report/path_analysis.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

#include "base/table_reader.hpp"
#include "casefile/markups.hpp"
#include "clients/cli/report/attached_file.hpp"

namespace bregma::cli::report {
namespace {

using Eigen::Vector3d;

// Turns a direction towards the positive end of the axis that it is nearest to, and returns that end's name.
std::string turn_to_anatomy(Vector3d &direction) {
  static constexpr std::array kNames{"right", "anterior", "superior"}; // RAS
  Eigen::Index axis = 0;
  direction.cwiseAbs().maxCoeff(&axis);
  if (direction[axis] < 0.0) {
    direction = -direction;
  }
  return kNames[static_cast<std::size_t>(axis)];
}

} // namespace

void read_plans(const casefile::SessionReader &reader, SessionAnalysis &out) {
  const auto names = reader.attachments();
  const auto attached = [&](const std::string &name) {
    return names && std::find(names->begin(), names->end(), name) != names->end();
  };
  if (!attached("case.toml")) {
    return;
  }
  const auto text = reader.attachment("case.toml");
  const auto document = text ? base::TomlDocument::parse(*text, "case.toml") : tl::unexpected(text.error());
  const std::string plans = document ? document->root().string("trajectories", "") : "";
  if (!attached(plans)) {
    return;
  }
  if (const auto file = AttachedFile::write(reader, plans, ".mrk.json")) {
    if (auto read = casefile::read_trajectories(file->path())) {
      out.plans = std::move(*read);
    }
  }
}

const casefile::Trajectory *plan_of(const SessionAnalysis &session, const std::string &trajectory) {
  const auto found = std::find_if(session.plans.begin(), session.plans.end(),
                                  [&](const casefile::Trajectory &plan) { return plan.name == trajectory; });
  return found == session.plans.end() ? nullptr : &*found;
}

AcrossPlan across(const casefile::Trajectory &plan) {
  const Vector3d along = (plan.target_mm - plan.entry_mm).normalized();
  // The anatomical axis that is most nearly across the line.
  Eigen::Index axis = 0;
  along.cwiseAbs().minCoeff(&axis);
  const Vector3d first = Vector3d::Unit(axis);
  AcrossPlan out;
  out.directions[0] = (first - first.dot(along) * along).normalized();
  out.directions[1] = along.cross(out.directions[0]);
  for (std::size_t i = 0; i < 2; ++i) {
    out.names[i] = turn_to_anatomy(out.directions[i]);
  }
  return out;
}

void summarise_path(SessionAnalysis &out) {
  // A pass: samples one after the other that are not farther from the target, along the path, than its entry is. Of
  // all, the one that came nearest to the target, and nearer than its entry is: a tool that is carried past the head
  // crosses the same depths. Beyond the target a deviation is none of the path.
  PathSummary pass;
  double pass_mm = geometry::kUnknown; // nearest distance from the target
  double best_mm = geometry::kUnknown;
  for (const PathSample &sample : out.path) {
    const casefile::Trajectory *plan = plan_of(out, sample.trajectory);
    const double length_mm = plan != nullptr ? (plan->target_mm - plan->entry_mm).norm() : geometry::kUnknown;
    const bool near = std::abs(sample.remaining_depth_mm) <= length_mm && std::isfinite(sample.lateral_mm);
    if (!near || sample.trajectory != pass.trajectory) {
      pass = {};
      pass.trajectory = sample.trajectory;
      pass_mm = geometry::kUnknown;
    }
    if (!near || sample.remaining_depth_mm < 0.0) {
      continue;
    }
    if (!(sample.lateral_mm <= pass.largest_lateral_mm)) {
      pass = {sample.trajectory, sample.time_ns, sample.lateral_mm, sample.remaining_depth_mm};
    }
    pass_mm = std::fmin(pass_mm, std::hypot(sample.remaining_depth_mm, sample.lateral_mm));
    if (pass_mm <= length_mm && !(pass_mm > best_mm)) { // also the first
      best_mm = pass_mm;
      out.path_summary = pass;
    }
  }
}

} // namespace bregma::cli::report
