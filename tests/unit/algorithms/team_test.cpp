// The team of threads: every thread takes part in every job, and a barrier separates what lies before and after it.
#include <atomic>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/parallel/team.hpp"

namespace bregma::parallel {
namespace {

TEST(Team, EveryThreadRunsEveryJobOnce) {
  for (const int threads : {1, 2, 5}) {
    Team team(threads);
    std::vector<int> calls(static_cast<std::size_t>(threads), 0);
    for (int job = 0; job < 1000; ++job) {
      team.run([&](int thread) { ++calls[static_cast<std::size_t>(thread)]; });
    }
    for (const int count : calls) {
      EXPECT_EQ(count, 1000) << threads << " threads";
    }
  }
}

TEST(Team, HasAtLeastTheCallersThread) {
  Team team(0);
  int calls = 0;
  team.run([&](int thread) {
    EXPECT_EQ(thread, 0);
    ++calls;
  });
  EXPECT_EQ(team.size(), 1);
  EXPECT_EQ(calls, 1);
}

TEST(Team, ABarrierShowsWhatTheOtherThreadsWroteBeforeIt) {
  constexpr int kThreads = 3;
  Team team(kThreads);
  std::vector<int> written(kThreads, 0);
  std::atomic<int> wrong{0};
  for (int job = 1; job <= 500; ++job) {
    team.run([&](int thread) {
      written[static_cast<std::size_t>(thread)] = job;
      team.barrier();
      for (const int value : written) {
        wrong += value == job ? 0 : 1;
      }
      team.barrier(); // no thread may write for the next job before all have read
    });
  }
  EXPECT_EQ(wrong.load(), 0);
}

} // namespace
} // namespace bregma::parallel
