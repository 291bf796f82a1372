#include "base/csv_table.hpp"

#include <gtest/gtest.h>

#include "tests/unit/casefile/files.hpp"

namespace bregma::base {
namespace {

using Cells = std::vector<std::vector<std::string>>;

class CsvTableTest : public testing::Test {
protected:
  CsvTable read(const std::string &content) {
    auto table = read_csv(folder.write("t.csv", content));
    EXPECT_TRUE(table) << table.error().message;
    return table.value_or(CsvTable{});
  }
  Cells cells(const std::string &content) {
    Cells out;
    for (const CsvRow &row : read(content).rows) {
      out.push_back(row.cells);
    }
    return out;
  }
  std::string refusal(const std::string &content) {
    const auto table = read_csv(folder.write("t.csv", content));
    return table ? "" : table.error().message.substr(table.error().message.find("t.csv"));
  }

  test::TemporaryFolder folder;
};

TEST_F(CsvTableTest, CellsAreBetweenCommasSemicolonsTabsOrBlanks) {
  const Cells expected{{"a", "1", "2"}, {"b", "3", "4"}};
  EXPECT_EQ(cells("a,1,2\nb,3,4\n"), expected);
  EXPECT_EQ(cells("a;1;2\r\nb;3;4\r\n"), expected);
  EXPECT_EQ(cells("a,1,2\rb,3,4\r"), expected);
  EXPECT_EQ(cells("a\t1\t2\nb\t3\t4"), expected);
  EXPECT_EQ(cells("  a   1 2 \n b 3  4\n"), expected);
  EXPECT_EQ(cells("a,1,2\n,,\nb,3,4\n,,\n"), expected);
  const Cells decimals{{"a", "1,5", "2,0"}, {"b", "3,5", "4"}};
  EXPECT_EQ(cells("a 1,5 2,0\nb 3,5 4\n"), decimals);
  EXPECT_EQ(cells("left ear,1,2\nright ear,3,4\n"), (Cells{{"left ear", "1", "2"}, {"right ear", "3", "4"}}));
  EXPECT_EQ(cells("1, 2, 3\n"), (Cells{{"1", "2", "3"}}));
  EXPECT_EQ(cells("\xEF\xBB\xBF"
                  "a,1,2\n\n# remark\nb,3,4\n"),
            expected);
  EXPECT_EQ(cells("a,1,2,,\nb,3,4,,\n"), expected);
}

TEST_F(CsvTableTest, QuotedCellsKeepSeparatorsAndQuotes) {
  EXPECT_EQ(cells("\"A, left\",1\n\"say \"\"B\"\"\",2\n"), (Cells{{"A, left", "1"}, {"say \"B\"", "2"}}));
  EXPECT_EQ(refusal("a,1\n\"b,2\n"), "t.csv:2: a quote is not closed");
}

TEST_F(CsvTableTest, Utf16IsConvertedAndOtherBytesAreRefused) {
  const std::string text = "\xC3\xA4,1\n"; // a with two dots
  EXPECT_EQ(cells(std::string("\xFF\xFE\xE4\x00,\x00\x31\x00\n\x00", 10)), cells(text));
  EXPECT_EQ(cells(std::string("\xFE\xFF\x00\xE4\x00,\x00\x31\x00\n", 10)), cells(text));
  EXPECT_EQ(refusal(std::string("\xFF\xFE\xE4", 3)), "t.csv: is not whole: its UTF-16 text ends within a character");
  EXPECT_EQ(refusal(std::string("a\0b", 3)), "t.csv: is not text (UTF-8, or UTF-16 with a byte order mark)");
}

TEST_F(CsvTableTest, NumbersMayHaveSignsAndDecimalCommas) {
  const CsvTable points = read("a,1.5,\"12,5\"\n");
  EXPECT_EQ(points.number("+1.5"), 1.5);
  EXPECT_EQ(points.number("-1.5e1"), -15.0);
  EXPECT_EQ(points.number("12,5"), 12.5);
  EXPECT_EQ(points.number("1,234"), std::nullopt) << "thousands, in a table with decimal points";
  EXPECT_EQ(points.number("1.234,5"), std::nullopt);
  for (const char *text : {"", "+", "+-1", "1,2,3", "x", "1 2", "0x10"}) {
    EXPECT_EQ(points.number(text), std::nullopt) << text;
  }
  const CsvTable commas = read("a;1,234;5\n");
  EXPECT_EQ(commas.number("1,234"), 1.234) << "a semicolon separates, so no comma does";
}

} // namespace
} // namespace bregma::base
