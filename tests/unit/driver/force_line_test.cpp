// The protocol of the example driver.
#include <gtest/gtest.h>

#include "examples/new_driver/force_line.hpp"
#include "tests/support/force_lines.hpp"

namespace force_line {
namespace {

using bregma::test::force_line_of;

TEST(ForceLine, AReadingIsParsed) {
  const auto reading = parse("$FRC,7,1234567,12.5,-3,1e2*1D");
  ASSERT_FALSE(reading); // the checksum of another line
  const auto good = parse(force_line_of("FRC,7,1234567,12.5,-3,1e2"));
  ASSERT_TRUE(good) << good.error();
  EXPECT_EQ(good->counter, 7U);
  EXPECT_EQ(good->time_us, 1'234'567);
  EXPECT_DOUBLE_EQ(good->force_N[0], 0.0125);
  EXPECT_DOUBLE_EQ(good->force_N[1], -0.003);
  EXPECT_DOUBLE_EQ(good->force_N[2], 0.1);
}

// Computed by hand: F ^ R ^ C is 0x57, of five commas one remains (0x2C), of five zeros one (0x30).
TEST(ForceLine, TheChecksumFollowsNmea) { EXPECT_TRUE(parse("$FRC,0,0,0,0,0*4B")); }

TEST(ForceLine, EveryDefectIsNamed) {
  const struct {
    std::string line;
    const char *error;
  } cases[] = {
      {"", "not a line of the sensor"},
      {"$GPS,1,2,3,4,5*00", "not a line of the sensor"},
      {"$FRC," + std::string(200, '1'), "not a line of the sensor"},
      {"$FRC,0,0,0,0,0", "wrong checksum"},
      {"$FRC,0,0,0,0,0*", "wrong checksum"},
      {"$FRC,0,0,0,0,0*4C", "wrong checksum"},
      {"$FRC,0,0,0,0,0*04B", "wrong checksum"},
      {"$FRC,0,0,0,0,0*xx", "wrong checksum"},
      {force_line_of("FRC,1,2,3,4"), "wrong number of fields"},
      {force_line_of("FRC,1,2,3,4,5,6"), "wrong number of fields"},
      {force_line_of("FRC,-1,2,3,4,5"), "counter or time is not a number in range"},
      {force_line_of("FRC,1,-2,3,4,5"), "counter or time is not a number in range"},
      {force_line_of("FRC,1,9223372036854775807,3,4,5"), "counter or time is not a number in range"},
      {force_line_of("FRC,1,2,3,,5"), "force is not a number in range"},
      {force_line_of("FRC,1,2,3,nan,5"), "force is not a number in range"},
      {force_line_of("FRC,1,2,3,4,1e300"), "force is not a number in range"},
  };
  for (const auto &bad : cases) {
    const auto parsed = parse(bad.line);
    ASSERT_FALSE(parsed) << bad.line;
    EXPECT_EQ(parsed.error(), bad.error) << bad.line;
  }
}

} // namespace
} // namespace force_line
