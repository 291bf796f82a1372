// Lines of a range sensor: what is written reads back, and damage is named.
#include <gtest/gtest.h>

#include "base/checked_line.hpp"
#include "drivers/range/range_line.hpp"

namespace bregma::range {
namespace {

std::string_view without_end(const std::string &line) { return std::string_view(line).substr(0, line.size() - 2); }

std::string problem_of(std::string_view body) {
  const auto read = parse(without_end(base::checked_line(body)));
  return read ? "none" : std::string(read.error());
}

TEST(RangeLine, MessagesReadBack) {
  for (const Message &message :
       {Message(Identity{"GP2Y0A21", "A4", 12, 3300}), Message(Reading{7, 1'234'567, 512}),
        Message(Reading{18'446'744'073'709'551'615U, kMaxTime_us, std::nullopt}), Message(Reading{0, 0, 0})}) {
    const std::string line = line_of(message);
    ASSERT_TRUE(line.ends_with("\r\n"));
    const auto read = parse(without_end(line));
    ASSERT_TRUE(read) << line << read.error();
    EXPECT_EQ(*read, message) << line;
  }
  EXPECT_TRUE(is_identity_question(without_end(identity_question())));
  EXPECT_FALSE(is_identity_question("$?*00"));
}

TEST(RangeLine, DamageIsNamed) {
  EXPECT_EQ(parse("$R,7,1000,512*00").error(), "wrong checksum");
  EXPECT_EQ(parse("R,7,1000,512").error(), "not a message of a range sensor");
  EXPECT_EQ(parse(std::string(200, '$')).error(), "line too long");
  EXPECT_EQ(problem_of("R,7,1000"), "not a reading");
  EXPECT_EQ(problem_of("R,-7,1000,512"), "not a reading");
  EXPECT_EQ(problem_of("R,7,1000,51x"), "not a reading");
  EXPECT_EQ(problem_of("R,7,1000,16777216"), "not a reading");
  EXPECT_EQ(problem_of("R,7,9000000000000000000,1"), "not a reading");
  EXPECT_EQ(problem_of("I,GP2Y0A21,,10,5000"), "not an identity");
  EXPECT_EQ(problem_of("I,GP2Y0A21,A4,25,5000"), "not an identity");
  EXPECT_EQ(problem_of("I,GP2Y0A21,A4,10,0"), "not an identity");
  EXPECT_EQ(problem_of("X"), "not a reading");
}

} // namespace
} // namespace bregma::range
