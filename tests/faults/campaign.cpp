#include "tests/faults/campaign.hpp"

#include <algorithm>
#include <future>
#include <iterator>
#include <stdexcept>
#include <string>
#include <thread>

#include "tests/faults/arm_run.hpp"

namespace bregma::faults {

namespace {

// Of the arm's cells, which take a second or two each because the arm touches the fiducials first: two of each subject,
// in sessions in which RobotScan and ArmBesideTracker do not meet them (those are navigating).
struct SampledArmRun {
  const char *cell;
  During session;
};
constexpr SampledArmRun kSampledArmRuns[] = {
    {"arm/silent", During::kVerified},
    {"arm/restarted: another driver", During::kRegistered},
    {"arm beside tracker/jumping: the arm's base is pushed", During::kVerified},
    {"arm beside tracker/silent: the reference is hidden", During::kRegistered},
    {"scan sensor/silent: unplugged", During::kRegistering},
    {"scan sensor/wrong tool: swapped", During::kRegistering},
};

void sample_arm_runs(std::vector<Planned> &out) {
  for (const SampledArmRun &run : kSampledArmRuns) {
    const auto &cells = matrix();
    const auto found =
        std::find_if(cells.begin(), cells.end(), [&](const Cell &cell) { return cell.name() == run.cell; });
    if (found == cells.end() || !meets_arm(*found, run.session)) {
      throw std::logic_error(std::string(run.cell) + ": there is no such run");
    }
    out.push_back({&*found, run.session});
  }
}

} // namespace

std::vector<Planned> all_runs() {
  std::vector<Planned> out;
  for (const Cell &cell : matrix()) {
    for (const During session : kAllSessions) {
      if (!is_arm_cell(cell) || meets_arm(cell, session)) {
        out.push_back({&cell, session});
      }
    }
  }
  return out;
}

std::vector<Planned> sampled_runs() {
  std::vector<During> others(std::begin(kAllSessions), std::end(kAllSessions));
  std::erase(others, During::kNavigating);
  std::vector<Planned> out;
  for (std::size_t i = 0; i < matrix().size(); ++i) {
    if (is_arm_cell(matrix()[i])) {
      continue; // below
    }
    out.push_back({&matrix()[i], During::kNavigating});
    out.push_back({&matrix()[i], others[i % others.size()]});
  }
  sample_arm_runs(out);
  for (const KnownFailure &known : known_failures()) {
    for (const Cell &cell : matrix()) {
      const bool sampled = std::any_of(out.begin(), out.end(), [&](const Planned &planned) {
        return planned.cell == &cell && planned.session == known.session;
      });
      if (known.session && !sampled && cell.name().starts_with(known.cell)) {
        out.push_back({&cell, *known.session});
      }
    }
  }
  return out;
}

Verdict judge(const Planned &planned, const Outcome &outcome) {
  if (outcome.holds()) {
    return Verdict::kHolds;
  }
  const bool known = std::all_of(outcome.violations.begin(), outcome.violations.end(), [&](const Violation &violation) {
    return find_known(*planned.cell, planned.session, violation) != nullptr;
  });
  return known ? Verdict::kKnownFailure : Verdict::kFails;
}

void Campaign::run(const std::vector<Planned> &plan, const Observer &observer) {
  const Sessions sessions;
  const std::size_t workers = std::max(1U, std::thread::hardware_concurrency());
  for (std::size_t first = 0; first < plan.size(); first += workers) {
    std::vector<std::future<Outcome>> outcomes;
    for (std::size_t i = first; i < std::min(first + workers, plan.size()); ++i) {
      outcomes.push_back(std::async(std::launch::async, [&sessions, planned = plan[i]] {
        return faults::run(sessions, *planned.cell, planned.session);
      }));
    }
    for (std::size_t i = 0; i < outcomes.size(); ++i) {
      const Planned &planned = plan[first + i];
      const Outcome outcome = outcomes[i].get();
      ++counts_[static_cast<std::size_t>(judge(planned, outcome))];
      for (const Violation &violation : outcome.violations) {
        if (const KnownFailure *known = find_known(*planned.cell, planned.session, violation)) {
          met_.insert(known);
        }
      }
      observer(planned, outcome);
    }
  }
}

std::vector<const KnownFailure *> Campaign::outdated() const {
  std::vector<const KnownFailure *> out;
  for (const KnownFailure &known : known_failures()) {
    if (!met_.contains(&known)) {
      out.push_back(&known);
    }
  }
  return out;
}

} // namespace bregma::faults
