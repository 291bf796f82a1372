#include "tests/faults/campaign.hpp"

#include <algorithm>
#include <future>
#include <iterator>
#include <thread>

#include "tests/faults/arm_run.hpp"

namespace bregma::faults {

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
      continue; // minutes of registering by an arm; ctest -R RobotScan has the same faults
    }
    out.push_back({&matrix()[i], During::kNavigating});
    out.push_back({&matrix()[i], others[i % others.size()]});
  }
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
