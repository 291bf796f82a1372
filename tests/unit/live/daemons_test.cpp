// Which of the daemons on a domain is shown, with clocks that the tests set.
#include <gtest/gtest.h>

#include "clients/live/daemons.hpp"

namespace {

using namespace bregma;
using namespace bregma::live;

constexpr std::int64_t kMs_ns = 1'000'000;
constexpr wire::BootId kBoot = {1};
constexpr dds::Guid kOne{1};
constexpr dds::Guid kTwo{2};
constexpr dds::Guid kThree{3};

class DaemonsTest : public ::testing::Test {
protected:
  // Health of a daemon whose wall clock is an hour ahead, published 2 ms ago.
  void health(const dds::Guid &who, std::int64_t now_ms) {
    auto &speaker = daemons.heard(who, now_ms * kMs_ns);
    const auto arrival = speaker.arrived(kBoot, (now_ms - 2) * kMs_ns, (3'600'000 + now_ms - 2) * kMs_ns,
                                         {now_ms * kMs_ns, now_ms * kMs_ns});
    speaker.said.health.emplace();
    speaker.said.health->arrival = arrival;
    speaker.said.health->started_time_ns = who[0];
  }
  std::int64_t shown(std::int64_t now_ms, bool writers_alive = true) {
    daemons.choose(writers_alive, now_ms * kMs_ns);
    return daemons.followed().health ? daemons.followed().health->started_time_ns : 0;
  }

  live::Daemons daemons{{1}};
};

TEST_F(DaemonsTest, TheFirstOneIsShownWhileItSpeaks) {
  EXPECT_EQ(shown(1'000), 0);
  health(kTwo, 1'000);
  EXPECT_EQ(shown(1'000), 2);
  for (std::int64_t ms = 1'001; ms < 20'000; ms += 500) {
    health(kOne, ms);
    EXPECT_EQ(shown(ms), 2);
    health(kTwo, ms + 250);
    EXPECT_EQ(shown(ms + 250), 2);
    EXPECT_EQ(daemons.others(ms * kMs_ns), std::vector{kOne});
  }
  EXPECT_EQ(daemons.followed().changes, 0U);
}

TEST_F(DaemonsTest, WhenItIsLostTheOneHeardEarliestFollows) {
  health(kTwo, 1'000);
  EXPECT_EQ(shown(1'000), 2);
  health(kThree, 1'100);
  health(kOne, 1'200);
  health(kOne, 2'900);
  health(kThree, 2'900);
  EXPECT_EQ(shown(2'997), 2) << "silent for 1,999 ms";
  EXPECT_EQ(shown(2'998), 3) << "silent for 2 s since it published";
  EXPECT_EQ(daemons.followed().changes, 1U);
  health(kTwo, 3'000);
  EXPECT_EQ(shown(3'000), 3) << "the first one, returning, is the other now";
}

TEST_F(DaemonsTest, WithoutALivingWriterNoneIsAliveAndNoneIsChosen) {
  health(kOne, 1'000);
  health(kTwo, 1'000);
  EXPECT_EQ(shown(1'000), 1);
  EXPECT_EQ(shown(1'100, false), 1) << "its last values stay, as not current";
  EXPECT_FALSE(live::alive(daemons.followed(), 1'100 * kMs_ns));
  EXPECT_EQ(shown(1'200, true), 1);
  EXPECT_TRUE(live::alive(daemons.followed(), 1'200 * kMs_ns));
}

TEST_F(DaemonsTest, AWriterWithoutHealthIsNamedButNeverShown) {
  for (std::int64_t ms = 1'000; ms < 3'000; ms += 20) {
    (void)daemons.heard(kThree, ms * kMs_ns);
    EXPECT_EQ(shown(ms), 0);
  }
  EXPECT_EQ(daemons.others(3'000 * kMs_ns), std::vector{kThree});
  EXPECT_TRUE(daemons.others(6'000 * kMs_ns).empty());
}

TEST_F(DaemonsTest, TheDaemonsClockIsMeasuredFromTheTransit) {
  health(kOne, 1'000);
  EXPECT_EQ(shown(1'000), 1);
  EXPECT_EQ(daemons.followed().clock_difference_ns, -3'600'000 * kMs_ns);
  EXPECT_EQ(live::daemon_now_ns(daemons.followed(), 1'500 * kMs_ns), 3'601'500 * kMs_ns);
}

} // namespace
