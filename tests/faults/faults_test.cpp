// A sample of the fault matrix: every cell while navigating and in one other session. All of it: ./dev faults.
#include <iostream>
#include <set>

#include <gtest/gtest.h>

#include "tests/faults/campaign.hpp"
#include "tests/faults/report.hpp"

namespace bregma::faults {
namespace {

TEST(FaultMatrix, NoSampledCellShowsWhatIsStaleOrInvalidAndEachRecovers) {
  Campaign campaign;
  std::cout << table_header();
  campaign.run(sampled_runs(), [](const Planned &planned, const Outcome &outcome) {
    std::cout << table_rows(planned, outcome);
    EXPECT_NE(judge(planned, outcome), Verdict::kFails) << table_rows(planned, outcome);
  });
  for (const KnownFailure *known : campaign.outdated()) {
    ADD_FAILURE() << "'" << known->cell << "' no longer breaks '" << known->rule
                  << "': remove it from tests/faults/known_failures.txt";
  }
}

TEST(FaultMatrix, EverySubjectAndEveryFaultHasACell) {
  std::set<Subject> subjects;
  std::set<Fault> faults;
  for (const Cell &cell : matrix()) {
    subjects.insert(cell.subject);
    faults.insert(cell.fault);
  }
  EXPECT_EQ(subjects.size(), static_cast<std::size_t>(Subject::kNetwork) + 1);
  EXPECT_EQ(faults.size(), static_cast<std::size_t>(Fault::kFlooded) + 1);
}

TEST(FaultMatrix, CellsHaveNamesOfTheirOwn) {
  std::set<std::string> names;
  for (const Cell &cell : matrix()) {
    EXPECT_TRUE(names.insert(cell.name()).second) << cell.name();
  }
}

} // namespace
} // namespace bregma::faults
