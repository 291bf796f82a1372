// The team of threads: every thread takes part in every job, and a barrier separates what lies before and after it.
#include <algorithm>
#include <atomic>
#include <cstddef>
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

TEST(Team, EveryPartIsDoneOnceWhenItReturns) {
  for (const int threads : {1, 2, 5}) {
    Team team(threads);
    std::vector<int> calls(17, 0);
    for (int job = 1; job <= 2000; ++job) {
      const std::size_t parts = static_cast<std::size_t>(job) % 18; // also none and one
      std::fill(calls.begin(), calls.end(), 0);
      team.run_parts(parts, [&](std::size_t part) { ++calls[part]; });
      for (std::size_t part = 0; part < calls.size(); ++part) {
        ASSERT_EQ(calls[part], part < parts ? 1 : 0) << threads << " threads, job " << job;
      }
    }
  }
}

// A thread that sleeps through jobs in parts takes part in the next job of all threads.
TEST(Team, JobsOfBothKindsFollowEachOther) {
  Team team(4);
  std::vector<int> by_thread(4, 0);
  std::vector<int> by_part(6, 0);
  for (int job = 0; job < 2000; ++job) {
    for (int again = 0; again < job % 4; ++again) {
      team.run_parts(by_part.size(), [&](std::size_t part) { ++by_part[part]; });
    }
    team.run([&](int thread) { ++by_thread[static_cast<std::size_t>(thread)]; });
  }
  for (const int count : by_thread) {
    EXPECT_EQ(count, 2000);
  }
  for (const int count : by_part) {
    EXPECT_EQ(count, 3000);
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
