#include "clients/cli/tissue/insertion.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/planning/surface_entry.hpp"
#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/material/constitutive.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {
namespace {

constexpr double kStandoff_mm = 2.0; // distance between tip and surface at the start
constexpr double kRowEvery_mm = 1.0;

double largest_von_mises_Pa(const tissue::ExplicitSolver &solver) {
  double largest = 0.0;
  for (int element = 0; element < solver.elements(); ++element) {
    largest = std::max(largest, tissue::von_mises_Pa(solver.cauchy_Pa(element)));
  }
  return largest;
}

InsertionUpdate seen_now(const tissue::BrainModel &model, double time_s, double depth_mm) {
  const tissue::PointPrediction &target = model.points().front();
  const bool known = target.inside && model.state().status != tissue::ModelStatus::kInvalid;
  return {.time_s = time_s,
          .depth_mm = depth_mm,
          .state = model.state(),
          .target_motion_mm = known ? target.displacement_mm.norm() : geometry::kUnknown,
          .target_error_bound_mm = known ? target.error_bound_mm : geometry::kUnknown,
          .target_von_mises_Pa = known ? target.von_mises_Pa : geometry::kUnknown,
          .largest_von_mises_Pa = largest_von_mises_Pa(model.solver())};
}

std::string state_text(const tissue::BrainState &state) {
  const std::string_view reason = tissue::sentence_of(state.reason);
  return std::string(tissue::name_of(state.status)) + (reason.empty() ? "" : ": " + std::string(reason));
}

} // namespace

base::Result<InsertionPath> InsertionPath::along(const casefile::Case &c, const casefile::Trajectory &trajectory,
                                                 double probe_radius_mm) {
  const auto entry =
      planning::surface_entry(surface::SurfaceModel(c.brain.mesh), trajectory.entry_mm, trajectory.target_mm);
  const std::string name = c.folder.string() + ": trajectory \"" + trajectory.name + "\" ";
  if (!entry) {
    return base::failure(name + "does not enter the brain");
  }
  if ((*entry - trajectory.entry_mm).norm() == 0.0) {
    return base::failure(name + "begins inside the brain: its entry is not known");
  }
  InsertionPath path;
  path.entry_mm_ = *entry;
  path.along_ = (trajectory.target_mm - trajectory.entry_mm).normalized();
  path.target_depth_mm_ = (trajectory.target_mm - *entry).norm();
  // If the path is oblique, the side of the tip reaches the surface before its end does.
  path.start_depth_mm_ = -kStandoff_mm - 2.0 * probe_radius_mm;
  return path;
}

std::vector<InsertionUpdate> insert(tissue::BrainModel &model, const InsertionPath &path, const InsertionPlan &plan,
                                    const std::function<bool(const InsertionUpdate &)> &goes_on) {
  const double elapsed_s = 1.0 / plan.rate_hz;
  const double whole_path_mm = plan.depth_mm - path.start_depth_mm();
  const int count = static_cast<int>(std::ceil(whole_path_mm / (plan.speed_mm_s * elapsed_s)));
  std::vector<InsertionUpdate> updates;
  updates.reserve(static_cast<std::size_t>(count) + 1);
  for (int i = 0; i <= count; ++i) {
    const double time_s = i * elapsed_s;
    const double depth_mm = std::min(plan.depth_mm, path.start_depth_mm() + plan.speed_mm_s * time_s);
    // Computes all steps of the elapsed time: simulated time waits for them.
    (void)model.update({.seen = true, .pose = path.pose(depth_mm), .force_N = std::nullopt}, elapsed_s,
                       std::numeric_limits<int>::max());
    updates.push_back(seen_now(model, time_s, depth_mm));
    if (!goes_on(updates.back())) {
      break;
    }
  }
  return updates;
}

int invalid_updates(std::span<const InsertionUpdate> updates) {
  return static_cast<int>(std::count_if(updates.begin(), updates.end(), [](const InsertionUpdate &update) {
    return update.state.status == tissue::ModelStatus::kInvalid;
  }));
}

bool lost(std::span<const InsertionUpdate> updates) {
  const bool diverged = std::any_of(updates.begin(), updates.end(), [](const InsertionUpdate &update) {
    return update.state.reason == tissue::ModelReason::kDiverged;
  });
  return diverged || updates.back().state.status == tissue::ModelStatus::kInvalid;
}

std::string insertion_table(std::span<const InsertionUpdate> updates) {
  Table table(
      {"depth mm", "phase", "tip N", "shaft N", "von Mises Pa", "at target Pa", "target moved mm", "+/- mm", "state"});
  const InsertionUpdate *last = nullptr;
  for (const InsertionUpdate &update : updates) {
    const bool due =
        last == nullptr || &update == &updates.back() || update.depth_mm >= last->depth_mm + kRowEvery_mm ||
        update.state.phase != last->state.phase ||
        (update.state.status == tissue::ModelStatus::kInvalid) != (last->state.status == tissue::ModelStatus::kInvalid);
    if (!due) {
      continue;
    }
    table.row({fixed(update.depth_mm, 1), std::string(tissue::name_of(update.state.phase)),
               fixed(update.state.tip_force_N, 4), fixed(update.state.shaft_force_N, 4),
               fixed(update.largest_von_mises_Pa, 0), fixed(update.target_von_mises_Pa, 1),
               fixed(update.target_motion_mm, 3), fixed(update.target_error_bound_mm, 3), state_text(update.state)});
    last = &update;
  }
  return table.text();
}

std::string insertion_csv(std::span<const InsertionUpdate> updates) {
  std::string out = "time_s,depth_mm,phase,status,reason,tip_force_N,shaft_force_N,shaft_in_tissue_mm,ruptures,"
                    "largest_von_mises_Pa,target_von_mises_Pa,target_motion_mm,target_error_bound_mm\n";
  for (const InsertionUpdate &update : updates) {
    const tissue::BrainState &state = update.state;
    char numbers[256];
    std::snprintf(numbers, sizeof numbers, "%.6g,%.6g,%.6g,%d,%.6g,%.6g,%.6g,%.6g\n", state.tip_force_N,
                  state.shaft_force_N, state.depth_mm, state.ruptures, update.largest_von_mises_Pa,
                  update.target_von_mises_Pa, update.target_motion_mm, update.target_error_bound_mm);
    char place[64];
    std::snprintf(place, sizeof place, "%.5f,%.4f,", update.time_s, update.depth_mm);
    out += place + std::string(tissue::name_of(state.phase)) + "," + std::string(tissue::name_of(state.status)) +
           ",\"" + std::string(tissue::sentence_of(state.reason)) + "\"," + numbers;
  }
  return out;
}

} // namespace bregma::cli
