// Runs of the matrix: which, in parallel, and what they show.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "tests/faults/known_failures.hpp"
#include "tests/faults/run.hpp"

namespace bregma::faults {

struct Planned {
  const Cell *cell;
  During session;
};
// Every cell in every session.
[[nodiscard]] std::vector<Planned> all_runs();
// Every cell while navigating and in one of the other sessions, in turn, and the runs that are known to fail. Without
// the cells of the arm, which take seconds each.
[[nodiscard]] std::vector<Planned> sampled_runs();

// A known failure is not a success, but does not fail the campaign.
enum class Verdict { kHolds, kKnownFailure, kFails };
[[nodiscard]] Verdict judge(const Planned &planned, const Outcome &outcome);

class Campaign {
public:
  using Observer = std::function<void(const Planned &, const Outcome &)>;

  // observer: called for every run, in the order of the plan.
  void run(const std::vector<Planned> &plan, const Observer &observer);

  [[nodiscard]] int count(Verdict verdict) const { return counts_[static_cast<std::size_t>(verdict)]; }
  // Entries of the list that no run has met.
  [[nodiscard]] std::vector<const KnownFailure *> outdated() const;

private:
  int counts_[3] = {};
  std::set<const KnownFailure *> met_;
};

} // namespace bregma::faults
