// The measurements of `bregma doctor`. The tests check no limits, which depend on the machine.
#include <fstream>

#include <gtest/gtest.h>
#include <unistd.h>

#include "clients/cli/doctor_measurements.hpp"
#include "clients/cli/doctor_network.hpp"
#include "tests/support/temporary_folder.hpp"

namespace {

using namespace bregma;
using namespace std::chrono_literals;

TEST(Doctor, SecondProcessAnswersEveryFrame) {
  cli::EchoProcess echo(100 + static_cast<std::uint32_t>(getpid()) % 100);
  const auto measured = echo.measure(100.0, 300ms);
  ASSERT_TRUE(measured.has_value()) << measured.error().message;
  EXPECT_GE(measured->sent, 20U);
  EXPECT_GT(measured->round_trip_us.count, 0U);
  EXPECT_LE(measured->round_trip_us.count, measured->sent);
  EXPECT_GT(measured->round_trip_us.p50, 0.0);
  EXPECT_LE(measured->round_trip_us.p50, measured->round_trip_us.p99);
  EXPECT_LE(measured->round_trip_us.p999, measured->round_trip_us.max);
}

TEST(Doctor, NamesTheInterfaceThatKeepsTooManyPacketsForSilentHosts) {
  const test::TemporaryFolder folder;
  const auto write = [&](const char *interface, const char *bytes) {
    std::filesystem::create_directories(folder / interface);
    std::ofstream(folder / interface / "unres_qlen_bytes") << bytes << "\n";
  };
  write("default", "212992");
  write("lo", "99999999");
  auto check = cli::check_unresolved_queue(folder.path());
  EXPECT_EQ(check.fitness, runtime::Fitness::kGood);
  EXPECT_EQ(check.finding, "at most 208 KiB are kept for each");
  write("enp3s0", "8388608");
  check = cli::check_unresolved_queue(folder.path());
  EXPECT_EQ(check.fitness, runtime::Fitness::kLimited);
  EXPECT_EQ(check.advice, "set sysctl net.ipv4.neigh.enp3s0.unres_qlen_bytes=212992");
  EXPECT_EQ(cli::check_unresolved_queue(folder / "none").fitness, runtime::Fitness::kLimited);
}

TEST(Doctor, TheDiskMeasurementLeavesNoFile) {
  const test::TemporaryFolder folder;
  const auto directory = folder / ".";
  const auto measured = cli::measure_disk(directory, 5);
  ASSERT_TRUE(measured.has_value()) << measured.error().message;
  EXPECT_EQ(measured->count, 5U);
  EXPECT_TRUE(std::filesystem::is_empty(directory));
}

TEST(Doctor, DirectoryThatCannotBeWrittenIsNamed) {
  const auto measured = cli::measure_disk("/proc", 1);
  ASSERT_FALSE(measured.has_value());
  EXPECT_EQ(measured.error().message.rfind("/proc: cannot be written: ", 0), 0U) << measured.error().message;
}

TEST(Doctor, AMissingDirectoryIsMeasuredInItsParent) {
  EXPECT_EQ(cli::existing_part("/usr/no/such/place"), "/usr");
  EXPECT_EQ(cli::existing_part("/usr"), "/usr");
  EXPECT_EQ(cli::existing_part("no-such-place"), ".");
}

TEST(Doctor, SpreadIsOfTheNearestRank) {
  const auto spread = cli::spread_of({4, 1, 3, 2});
  EXPECT_EQ(spread.p50, 2.0);
  EXPECT_EQ(spread.p99, 4.0);
  EXPECT_EQ(cli::spread_of({}).count, 0U);
}

TEST(RecordingSpace, HoursFollowFromTheRateOfARecording) {
  EXPECT_NEAR((casefile::RecordingSpace{8'640'000'000, casefile::kTypicalBytesPerSecond}.hours()), 1.0, 1e-12);
  const auto here = cli::recording_space(".");
  ASSERT_TRUE(here.has_value()) << here.error().message;
  EXPECT_GT(here->free_bytes, 0U);
  EXPECT_FALSE(cli::recording_space("/nowhere").has_value());
}

} // namespace
