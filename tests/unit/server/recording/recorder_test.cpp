#include <array>
#include <thread>

#include <gtest/gtest.h>

#include "casefile/session_file/growth.hpp"
#include "server/recording/recorder.hpp"
#include "server/recording/recording_space.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/server/recording/recording_support.hpp"

namespace bregma::recording {
namespace {

using namespace std::chrono_literals;
using test::navigation;
using test::range;

std::vector<std::uint64_t> recorded_frames(const std::filesystem::path &file) {
  std::vector<std::uint64_t> frames;
  auto reader = casefile::SessionReader::open(file);
  EXPECT_TRUE(reader) << reader.error().message;
  EXPECT_TRUE(reader->each<wire::NavigationState>(
      [&](const wire::NavigationState &state, std::int64_t) { frames.push_back(state.frame); }));
  return frames;
}

TEST(Recorder, KeepsTheOrderOfEachOfSeveralThreads) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.session";
  constexpr std::uint64_t kEach = 5'000;
  {
    Recorder recorder;
    auto &first = recorder.channel("navigation");
    auto &second = recorder.channel("inputs");
    EXPECT_EQ(&recorder.channel("navigation"), &first);
    ASSERT_TRUE(recorder.open(file, {{"case.toml", "id = \"a\""}}, {{"case", "a"}}));
    std::thread navigating([&] {
      for (std::uint64_t i = 1; i <= kEach; ++i) {
        while (!first.push(static_cast<std::int64_t>(i), navigation(i))) {
          std::this_thread::sleep_for(1ms); // only in the test: a loop would continue
        }
      }
    });
    std::thread taking([&] {
      for (std::uint64_t i = 1; i <= kEach; ++i) {
        second.push(static_cast<std::int64_t>(i), range(i));
      }
    });
    navigating.join();
    taking.join();
    ASSERT_TRUE(recorder.attach({"scalp.ply", "mesh"}));
    ASSERT_TRUE(recorder.close());
    const auto status = recorder.status();
    EXPECT_EQ(status.recorded + status.dropped, first.pushed() + second.pushed());
    EXPECT_FALSE(status.open);
    EXPECT_FALSE(status.failing);
  }
  const auto frames = recorded_frames(file);
  ASSERT_EQ(frames.size(), kEach);
  for (std::uint64_t i = 0; i < kEach; ++i) {
    ASSERT_EQ(frames[i], i + 1);
  }
  const auto reader = casefile::SessionReader::open(file);
  EXPECT_EQ(reader->attachment("case.toml").value(), "id = \"a\"");
  EXPECT_EQ(reader->attachment("scalp.ply").value(), "mesh");
  EXPECT_EQ(reader->meta("case").value(), "a");
}

TEST(Recorder, RecordsThatDoNotFitAreDroppedAndCounted) {
  const test::TemporaryFolder folder;
  Recorder recorder({.channel_bytes = 16'384, .interval = 5ms});
  auto &channel = recorder.channel("navigation");
  ASSERT_TRUE(recorder.open(folder / "a.session", {}, {}));
  for (std::uint64_t i = 1; i <= 20'000; ++i) { // much faster than the disk
    channel.push(static_cast<std::int64_t>(i), navigation(i));
  }
  ASSERT_TRUE(recorder.close());
  const auto status = recorder.status();
  EXPECT_EQ(channel.pushed(), 20'000U);
  EXPECT_GT(status.dropped, 0U);
  EXPECT_EQ(status.dropped, channel.dropped());
  EXPECT_EQ(status.recorded + status.dropped, channel.pushed());
  EXPECT_EQ(recorded_frames(folder / "a.session").size(), status.recorded);
  const auto reader = casefile::SessionReader::open(folder / "a.session");
  EXPECT_EQ(reader->meta("dropped").value(), std::to_string(status.dropped)); // the file states its missing records
}

TEST(Recorder, StatesTheSpaceOfItsDiskWhileItRecords) {
  const test::TemporaryFolder folder;
  Recorder recorder({.copy = 5ms});
  EXPECT_EQ(recorder.status().space.bytes_per_s, 0.0);
  ASSERT_TRUE(recorder.open(folder / "a.session", {}, {}));
  ASSERT_TRUE(test::eventually([&] { return recorder.status().space.bytes_per_s > 0.0; }));
  const casefile::RecordingSpace space = recorder.status().space;
  const auto disk = std::filesystem::space(folder / ".").capacity;
  EXPECT_GT(space.free_bytes, 0U);
  EXPECT_LE(space.free_bytes, disk);
  EXPECT_EQ(space.bytes_per_s, casefile::kTypicalBytesPerSecond) << "during the first minute";
  EXPECT_DOUBLE_EQ(space.hours(), static_cast<double>(space.free_bytes) / 2.4e6 / 3600.0);
  ASSERT_TRUE(recorder.close());
  EXPECT_EQ(recorder.status().space.bytes_per_s, 0.0);
}

TEST(RecordingGrowth, IsTheFastestMinute) {
  RecordingGrowth growth;
  growth.observe(1'000'000, 100.0);
  EXPECT_EQ(growth.bytes_per_s(), casefile::kTypicalBytesPerSecond);
  growth.observe(50'000'000, 159.0);
  EXPECT_EQ(growth.bytes_per_s(), casefile::kTypicalBytesPerSecond) << "less than a minute";
  growth.observe(61'000'000, 160.0);
  EXPECT_DOUBLE_EQ(growth.bytes_per_s(), 1e6);
  growth.observe(62'000'000, 220.0);
  EXPECT_DOUBLE_EQ(growth.bytes_per_s(), 1e6) << "a quiet minute";
  growth.observe(302'000'000, 280.0);
  EXPECT_DOUBLE_EQ(growth.bytes_per_s(), 4e6);
  growth.observe(200'000'000, 340.0);
  EXPECT_DOUBLE_EQ(growth.bytes_per_s(), 4e6) << "the log was emptied";
}

TEST(RecordingGrowth, CountsTheLogWithTheFile) {
  const test::TemporaryFolder folder;
  folder.write("a.db", "12345");
  folder.write("a.db-wal", "123");
  EXPECT_EQ(recording_bytes(folder / "a.db"), 8U);
  EXPECT_EQ(recording_bytes(folder / "none.db"), 0U);
}

TEST(Recorder, OpensOneFileAfterAnother) {
  const test::TemporaryFolder folder;
  Recorder recorder;
  auto &channel = recorder.channel("navigation");
  EXPECT_TRUE(channel.push(0, navigation(99))); // no file is open: records are ignored
  for (std::uint64_t i = 1; i <= 3; ++i) {
    ASSERT_TRUE(recorder.open(folder / std::to_string(i), {}, {}));
    EXPECT_TRUE(channel.push(0, navigation(i)));
  }
  ASSERT_TRUE(recorder.close());
  EXPECT_TRUE(channel.push(0, navigation(100)));
  for (std::uint64_t i = 1; i <= 3; ++i) {
    EXPECT_EQ(recorded_frames(folder / std::to_string(i)), std::vector<std::uint64_t>{i});
  }
  EXPECT_EQ(recorder.status().recorded, 3U);
  EXPECT_EQ(recorder.status().dropped, 0U);
}

TEST(Recorder, ReportsWhyAFileCannotBeOpenedAndOpensTheNext) {
  const test::TemporaryFolder folder;
  Recorder recorder;
  const auto refused = recorder.open(folder / "no/a.session", {}, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message,
            (folder / "no/a.session").string() + ": there is no folder " + (folder / "no").string());
  const auto attached = recorder.attach({"case.toml", ""});
  ASSERT_FALSE(attached);
  EXPECT_EQ(attached.error().message, "attachment case.toml: no session file is open");
  EXPECT_FALSE(recorder.status().open);
  EXPECT_TRUE(recorder.open(folder / "a.session", {}, {}));
  EXPECT_TRUE(recorder.status().open);
}

TEST(Recorder, PollsASourceThatNoPipelineSees) {
  const test::TemporaryFolder folder;
  std::atomic<std::uint64_t> polls{0};
  {
    Recorder recorder({.interval = 1ms});
    recorder.set_poll([&](Channel &channel) { channel.push(0, navigation(++polls)); });
    EXPECT_TRUE(test::eventually([&] { return polls > 3; })); // also while no file is open
    ASSERT_TRUE(recorder.open(folder / "a.session", {}, {}));
    const auto opened = polls.load();
    EXPECT_TRUE(test::eventually([&] { return polls > opened + 3; }));
  }
  const auto frames = recorded_frames(folder / "a.session");
  ASSERT_GE(frames.size(), 3U);
  EXPECT_GT(frames.front(), 3U);
  EXPECT_EQ(frames.back() - frames.front() + 1, frames.size());
}

TEST(Recorder, PushingAllocatesNothing) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "allocations are not counted under sanitizers";
  }
  const test::TemporaryFolder folder;
  Recorder recorder;
  auto &channel = recorder.channel("navigation");
  ASSERT_TRUE(recorder.open(folder / "a.session", {}, {}));
  const auto sample = navigation(1);
  const test::AllocationScope scope;
  for (int i = 0; i < 10'000; ++i) {
    channel.push(i, sample);
  }
  static_cast<void>(recorder.status());
  EXPECT_EQ(scope.count(), 0U);
}

} // namespace
} // namespace bregma::recording
