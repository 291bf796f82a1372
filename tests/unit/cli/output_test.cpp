#include <limits>

#include <gtest/gtest.h>

#include "clients/cli/output.hpp"

namespace {

using namespace bregma::cli;

TEST(Output, TablesAlignFiguresRightAndTextLeft) {
  Table table({"Name", "mm", ""});
  table.row({"Nasion", "1.25", "ok"});
  table.row({"Ä", "-12.50", ""});
  table.row({"none", "-"});
  EXPECT_EQ(table.text(), "Name        mm\nNasion    1.25  ok\nÄ       -12.50\nnone         -\n");
}

TEST(Output, WhatIsNotKnownIsNotANumber) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(fixed(nan, 2), "-");
  EXPECT_EQ(fixed(std::numeric_limits<double>::infinity(), 2, "mm"), "-");
  EXPECT_EQ(fixed(1.005, 1, "mm"), "1.0 mm");
  EXPECT_EQ(fixed(-0.0004, 2), "0.00") << "a zero without a sign";
  EXPECT_EQ(vector_text({1, -2, nan}, 1), "(1.0, -2.0, -)");
  EXPECT_TRUE(json_number(nan).is_null());
  EXPECT_EQ(json_vector({1, 2, nan}).dump(), "[1.0,2.0,null]");
}

} // namespace
