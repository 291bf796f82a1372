// The measurements of `bregma doctor`. The tests check no limits, which depend on the machine.
#include <gtest/gtest.h>
#include <unistd.h>

#include "clients/cli/doctor_measurements.hpp"
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

} // namespace
