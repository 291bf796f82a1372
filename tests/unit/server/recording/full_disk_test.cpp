// A disk that is full and then has space again. Recording continues, the recorder reports the error, and every record
// is either in the file or counted as dropped.
#include <csignal>
#include <fstream>
#include <sys/mount.h>
#include <sys/resource.h>

#include <gtest/gtest.h>

#include "server/recording/recorder.hpp"
#include "tests/unit/server/recording/recording_support.hpp"

namespace bregma::recording {
namespace {

using namespace std::chrono_literals;
using test::navigation;

void record_through_a_full_disk(const std::filesystem::path &file, const std::string &reason,
                                const std::function<void()> &fill, const std::function<void()> &make_room) {
  Recorder recorder({.channel_bytes = 65'536, .interval = 1ms, .retry = 2ms});
  auto &channel = recorder.channel("navigation");
  ASSERT_TRUE(recorder.open(file, {}, {}));
  std::uint64_t frame = 0;
  const auto push = [&] { return channel.push(0, navigation(++frame)); };

  for (int i = 0; i < 50; ++i) {
    push();
  }
  ASSERT_TRUE(test::eventually([&] { return recorder.status().recorded > 0; }));
  fill();
  ASSERT_TRUE(test::eventually([&] {
    push();
    return recorder.status().failing;
  }));
  const auto failing = recorder.status();
  EXPECT_EQ(std::string(failing.text), file.string() + ": " + reason);
  for (int i = 0; i < 1'000; ++i) {
    push();
  }
  EXPECT_GT(recorder.status().dropped, 0U);

  make_room();
  ASSERT_TRUE(test::eventually([&] { return !recorder.status().failing; }));
  ASSERT_TRUE(test::eventually([&] { return push(); })); // the ring has space again
  ASSERT_TRUE(recorder.close());
  const auto status = recorder.status();
  EXPECT_FALSE(status.failing);
  EXPECT_EQ(status.recorded + status.dropped, frame);

  const auto reader = casefile::SessionReader::open(file);
  ASSERT_TRUE(reader) << reader.error().message;
  std::uint64_t previous = 0;
  std::uint64_t missing = 0;
  const auto read = reader->each<wire::NavigationState>([&](const wire::NavigationState &state, std::int64_t) {
    EXPECT_GT(state.frame, previous); // no duplicates, although writes were retried
    missing += state.frame - previous - 1;
    previous = state.frame;
  });
  EXPECT_EQ(read.value(), status.recorded);
  EXPECT_EQ(missing, status.dropped);
}

TEST(FullDisk, AFileSizeLimitIsReportedAndRecordingContinues) {
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto limit = [&](rlim_t size) {
    const rlimit now{size, before.rlim_max};
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &now), 0);
  };
  const test::TemporaryFolder folder;
  record_through_a_full_disk(
      folder / "a.session", "disk I/O error", [&] { limit(1'000'000); }, [&] { limit(before.rlim_cur); });
  limit(before.rlim_cur);
}

TEST(FullDisk, AFullFileSystemIsReportedAndRecordingContinues) {
  const test::TemporaryFolder folder;
  if (mount("tmpfs", folder.path().c_str(), "tmpfs", 0, "size=4m") != 0) {
    GTEST_SKIP() << "a small file system needs the right to mount one";
  }
  record_through_a_full_disk(
      folder / "a.session", "database or disk is full",
      [&] {
        std::ofstream filler(folder / "filler");
        while (filler << std::string(65'536, 'x') << std::flush) {
        }
      },
      [&] { std::filesystem::remove(folder / "filler"); });
  umount(folder.path().c_str());
}

TEST(FullDisk, RecordsThatTheDiskRejectedAreCountedAtTheEnd) {
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const test::TemporaryFolder folder;
  Recorder recorder({.interval = 1ms, .retry = 2ms});
  auto &channel = recorder.channel("navigation");
  ASSERT_TRUE(recorder.open(folder / "a.session", {}, {}));
  const rlimit small{100'000, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  for (std::uint64_t i = 1; i <= 1'000; ++i) {
    EXPECT_TRUE(channel.push(0, navigation(i)));
  }
  const auto closed = recorder.close();
  EXPECT_FALSE(closed);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  const auto status = recorder.status();
  EXPECT_EQ(status.recorded + status.dropped, 1'000U);
  EXPECT_GT(status.dropped, 0U);
  EXPECT_FALSE(status.failing); // a closed file has no error state
}

TEST(FullDisk, TheNextFileIsOpenedIfTheLastOneCouldNotBeFinished) {
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const test::TemporaryFolder folder;
  Recorder recorder({.interval = 1ms, .retry = 2ms});
  auto &channel = recorder.channel("navigation");
  ASSERT_TRUE(recorder.open(folder / "a.session", {}, {}));
  const rlimit small{200'000, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  for (std::uint64_t i = 1; i <= 1'000; ++i) {
    EXPECT_TRUE(channel.push(0, navigation(i)));
  }
  EXPECT_TRUE(test::eventually([&] { return recorder.status().failing; }));
  EXPECT_TRUE(recorder.open(folder / "b.session", {}, {}));
  EXPECT_FALSE(recorder.status().failing);
  EXPECT_TRUE(recorder.status().open);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
}

} // namespace
} // namespace bregma::recording
