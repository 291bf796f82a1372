#include "server/stages/case_store.hpp"

#include <gtest/gtest.h>

#include "tests/unit/casefile/sample_case.hpp"

namespace bregma::server {
namespace {

std::unique_ptr<LoadedCase> a_case() {
  return std::make_unique<LoadedCase>(std::make_shared<const casefile::Case>(tests::sample_case("/cases/sample")), 12.0,
                                      100);
}

TEST(CaseStore, ACaseIsFreedWhenEveryLeaseHasTakenTheNextOne) {
  CaseStore store;
  CaseLease quick;
  CaseLease slow;
  quick.connect(store);
  slow.connect(store);
  EXPECT_FALSE(quick.newer());

  const CaseChanged first = store.add(a_case());
  ASSERT_TRUE(quick.newer());
  EXPECT_EQ(quick.newer()->loaded, first.loaded);
  quick.take(first);
  slow.take(first);
  EXPECT_FALSE(quick.newer());

  const CaseChanged second = store.add(a_case());
  quick.take(second);
  store.free_unused();
  EXPECT_EQ(store.held(), 2U); // `slow` still uses the first case
  slow.take(second);
  store.free_unused();
  EXPECT_EQ(store.held(), 1U);
}

TEST(CaseStore, AStageMayMissCasesInBetween) {
  CaseStore store;
  CaseLease lease;
  lease.connect(store);
  (void)store.add(a_case());
  (void)store.add(a_case());
  const CaseChanged closed = store.add(nullptr);
  store.free_unused();
  EXPECT_EQ(store.held(), 3U); // the lease holds none of them yet and could take any of them
  ASSERT_TRUE(lease.newer());
  EXPECT_EQ(lease.newer()->generation, closed.generation);
  EXPECT_EQ(lease.newer()->loaded, nullptr);
  lease.take(closed);
  store.free_unused();
  EXPECT_EQ(store.held(), 1U); // the entry for no case
}

} // namespace
} // namespace bregma::server
