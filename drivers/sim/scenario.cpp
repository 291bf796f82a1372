#include "drivers/sim/scenario.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "base/table_reader.hpp"
#include "idl/names.hpp"

namespace bregma::sim {

namespace {

using base::TableReader;

constexpr std::array<std::pair<std::string_view, StepKind>, 13> kStepNames{
    {{"load_case", StepKind::kLoadCase},
     {"pivot", StepKind::kPivot},
     {"start_registration", StepKind::kStartRegistration},
     {"touch_fiducials", StepKind::kTouchFiducials},
     {"trace_scalp", StepKind::kTraceScalp},
     {"accept_registration", StepKind::kAcceptRegistration},
     {"check_landmarks", StepKind::kCheckLandmarks},
     {"confirm_verification", StepKind::kConfirmVerification},
     {"start_navigation", StepKind::kStartNavigation},
     {"follow_trajectory", StepKind::kFollowTrajectory},
     {"wait", StepKind::kWait},
     {"stop_navigation", StepKind::kStopNavigation},
     {"close_case", StepKind::kCloseCase}}};

constexpr std::array<std::pair<std::string_view, FaultKind>, 6> kFaultNames{
    {{"occlusion", FaultKind::kOcclusion},
     {"tracker_silent", FaultKind::kTrackerSilent},
     {"reference_bump", FaultKind::kReferenceBump},
     {"clock_jump", FaultKind::kClockJump},
     {"bad_samples", FaultKind::kBadSamples},
     {"flood", FaultKind::kFlood}}};

constexpr std::array<std::pair<std::string_view, BadSample>, 8> kBadSampleNames{
    {{"not_finite", BadSample::kNotFinite},
     {"not_a_rotation", BadSample::kNotARotation},
     {"time_backwards", BadSample::kTimeBackwards},
     {"time_in_future", BadSample::kTimeInFuture},
     {"unknown_device", BadSample::kUnknownDevice},
     {"unknown_tool", BadSample::kUnknownTool},
     {"duplicate", BadSample::kDuplicate},
     {"malformed", BadSample::kMalformed}}};

// The step's name is published with the truth, with the suffix ":hold" while the target is held.
constexpr std::size_t kMaxStepName = wire::kNameLength - std::string_view(":hold").size();

template <class Enum, std::size_t N>
Enum require_enum(TableReader &table, std::string_view key,
                  const std::array<std::pair<std::string_view, Enum>, N> &names) {
  std::vector<std::string> choices;
  choices.reserve(N);
  for (const auto &entry : names) {
    choices.emplace_back(entry.first);
  }
  const std::string chosen = table.require_choice(key, choices);
  const auto *const found =
      std::find_if(names.begin(), names.end(), [&chosen](const auto &entry) { return entry.first == chosen; });
  return found == names.end() ? names.front().second : found->second;
}

Step read_step(TableReader &table) {
  Step step;
  step.kind = require_enum(table, "do", kStepNames);
  step.name = table.string("name", std::string(name_of(step.kind)));
  if (step.name.empty() || step.name.size() > kMaxStepName) {
    table.refuse("name", "must have 1 to " + std::to_string(kMaxStepName) + " bytes");
  }
  step.may_fail = table.flag("may_fail", false);
  switch (step.kind) {
  case StepKind::kPivot:
    step.tool = table.require_string("tool");
    step.duration_s = table.number("duration_s", 8.0, "s", 1.0, 600.0);
    break;
  case StepKind::kTouchFiducials:
  case StepKind::kCheckLandmarks:
    step.tool = table.require_string("tool");
    step.points = table.strings("points");
    break;
  case StepKind::kTraceScalp:
    step.tool = table.require_string("tool");
    step.length_mm = table.number("length_mm", 800.0, "mm", 50.0, 20000.0);
    step.speed_mm_s = table.number("speed_mm_s", 55.0, "mm/s", 5.0, 300.0);
    break;
  case StepKind::kStartNavigation:
    step.tool = table.require_string("tool");
    step.trajectory = table.string("trajectory", "");
    break;
  case StepKind::kFollowTrajectory:
    step.tool = table.require_string("tool");
    step.trajectory = table.require_string("trajectory");
    step.speed_mm_s = table.number("speed_mm_s", 8.0, "mm/s", 0.5, 50.0);
    step.duration_s = table.number("duration_s", 3.0, "s", 0.0, 3600.0);
    break;
  case StepKind::kWait:
    step.duration_s = table.require_number("duration_s", "s", 0.0, 86400.0);
    break;
  default:
    break;
  }
  return step;
}

void read_bump(TableReader &table, Fault &fault) {
  if (table.has("vector_mm")) {
    fault.vector_mm = table.require_vector3("vector_mm");
    if (table.has("magnitude_mm")) {
      table.refuse("magnitude_mm", "is given by vector_mm; only one of the two can be given");
    }
  } else {
    fault.magnitude_mm = table.number("magnitude_mm", 2.0, "mm", 0.0, 100.0);
  }
}

Fault read_fault(TableReader &table, const std::vector<Step> &steps) {
  Fault fault;
  fault.kind = require_enum(table, "kind", kFaultNames);
  fault.step = table.string("step", "");
  const auto named = [&fault](const Step &step) { return step.name == fault.step; };
  if (!fault.step.empty() && std::none_of(steps.begin(), steps.end(), named)) {
    table.refuse("step", "no step of this scenario has that name");
  }
  fault.after_s = table.number("after_s", 0.0, "s", 0.0, 86400.0);
  switch (fault.kind) {
  case FaultKind::kOcclusion:
    fault.tool = table.require_string("tool");
    fault.duration_s = table.require_number("duration_s", "s", 0.001, 86400.0);
    break;
  case FaultKind::kTrackerSilent:
    fault.duration_s = table.require_number("duration_s", "s", 0.001, 86400.0);
    break;
  case FaultKind::kReferenceBump:
    read_bump(table, fault);
    break;
  case FaultKind::kClockJump:
    fault.jump_ms = table.require_number("jump_ms", "ms", -86400e3, 86400e3);
    break;
  case FaultKind::kBadSamples:
    fault.sample = require_enum(table, "sample", kBadSampleNames);
    fault.count = table.integer("count", 1, "", 1, 1'000'000);
    break;
  case FaultKind::kFlood:
    fault.device = table.choice("device", "Tracker", {"Tracker", "Robot", "Force", "Range"});
    fault.factor = table.number("factor", 10.0, "", 1.0, 100.0);
    fault.duration_s = table.require_number("duration_s", "s", 0.001, 86400.0);
    break;
  }
  return fault;
}

base::Result<Scenario> read(const base::TomlDocument &document) {
  TableReader root = document.root();
  Scenario scenario;
  read_parameters(root, scenario);
  if (!root.has("steps")) {
    root.refuse("steps", "a scenario needs at least one [[steps]]");
  }
  for (TableReader &table : root.tables("steps")) {
    scenario.steps.push_back(read_step(table));
    (void)table.finish();
  }
  for (TableReader &table : root.tables("faults")) {
    scenario.faults.push_back(read_fault(table, scenario.steps));
    (void)table.finish();
  }
  if (auto limits = root.table("limits")) {
    scenario.limits = casefile::read_run_limits(*limits);
    (void)limits->finish();
  }
  if (const auto ok = root.finish(); !ok) { // the first error of the whole file
    return tl::unexpected(ok.error());
  }
  return scenario;
}

} // namespace

std::string_view name_of(StepKind kind) {
  const auto *const found =
      std::find_if(kStepNames.begin(), kStepNames.end(), [kind](const auto &entry) { return entry.second == kind; });
  return found == kStepNames.end() ? std::string_view("?") : found->first;
}

base::Result<Scenario> load_scenario(const std::filesystem::path &file) {
  const auto document = base::TomlDocument::read(file);
  return document ? read(*document) : tl::unexpected(document.error());
}

base::Result<Scenario> parse_scenario(std::string_view toml, const std::string &name) {
  const auto document = base::TomlDocument::parse(toml, name);
  return document ? read(*document) : tl::unexpected(document.error());
}

} // namespace bregma::sim
