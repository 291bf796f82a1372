#include "casefile/point_table.hpp"

#include <gtest/gtest.h>

#include "tests/unit/casefile/files.hpp"

namespace bregma::casefile {
namespace {

class PointTableTest : public testing::Test {
protected:
  base::Result<PointTable> read(const std::string &content, const PointTableOptions &options = {}) {
    return read_point_table(folder.write("p.csv", content), options);
  }
  // The position of the first point, and its name.
  void expect(const std::string &content, const Eigen::Vector3d &position, const std::string &name,
              const PointTableOptions &options = {}) {
    const auto table = read(content, options);
    ASSERT_TRUE(table) << content << ": " << table.error().message;
    ASSERT_FALSE(table->points.empty()) << content;
    EXPECT_TRUE(table->points[0].position_mm.isApprox(position, 1e-12)) << content << table->points[0].position_mm;
    EXPECT_EQ(table->points[0].name, name) << content;
  }
  std::string refusal(const std::string &content) {
    const auto table = read(content);
    return table ? "" : table.error().message.substr(table.error().message.find("p.csv"));
  }

  test::TemporaryFolder folder;
  const Eigen::Vector3d p{1.0, 2.0, 3.0};
};

TEST_F(PointTableTest, ColumnsAreReadByName) {
  expect("name,x,y,z\nA,1,2,3\n", p, "A");
  expect("Z;Y;X;Label\n3;2;1;A\n", p, "A");
  expect("label,l,p,s\nA,-1,-2,3\n", p, "A");
  expect("label,R,A,I\nA,1,2,-3\n", p, "A");
  expect("id,x,y,z,label\n7,1,2,3,A\n", p, "A");
  expect("id,x,y,z\n7,1,2,3\n", p, "7");
  expect("x [cm],y (cm),z_cm\n0.1,0.2,0.3\n", p, "1");
  expect("x,y,z,t\n-1,-2,3,0\n", p, "1");
  expect("# x y z\n1 2 3\n", p, "1");
  expect("Type, pos_x, pos_y, pos_z, name\nElectrode, 1, 2, 3, Cz\n", p, "Cz");
  expect("Left\tPosterior\tSuperior\n-1\t-2\t3\n", p, "1");
  expect("name,x,y,z\nA,-1,-2,3\n", p, "A", {.space = Space::kLps});
  expect("name,x,y,z\nA,0.001,0.002,0.003\n", p, "A", {.unit = LengthUnit::kMetre});
}

TEST_F(PointTableTest, CommentsStateColumnsSpaceAndUnitAsWell) {
  expect("# label,l,p,s\nA,-1,-2,3\n", p, "A");
  expect("# CoordinateSystem = LPS\nA,-1,-2,3\n", p, "A");
  expect("# CoordinateSystem = LPS\n# columns = label,z,y,x\nA,3,-2,-1\n", p, "A");
  expect("# coordinate system: 1\nA,-1,-2,3\n", p, "A", {.space = Space::kRas});
  expect("# space: lps\n-1,-2,3\n", p, "1");
  expect("# space: the operating room\n1,2,3\n", p, "1");
  expect("# units: cm\nx,y,z\n0.1,0.2,0.3\n", p, "1");
  expect("# a point is x y z\n1,2,3\n", p, "1");
  expect("# note: columns x, y, z of the tracker\n1,2,3\n", p, "1");
  EXPECT_TRUE(read("# CoordinateSystem = RAS\n1,2,3\n")->notes.empty());
  EXPECT_EQ(refusal("# name,z,y,x,weight\nA,3,2,1\n").rfind("p.csv:1: column \"weight\" is not known", 0), 0U);
  EXPECT_EQ(refusal("# CoordinateSystem = IJK\n1,2,3\n"), "p.csv:1: CoordinateSystem = IJK: must be LPS or RAS");
  EXPECT_EQ(refusal("# units: inches\n1,2,3\n"), "p.csv:1: units: inches: must be mm, cm, m or um");
  EXPECT_EQ(refusal("# CoordinateSystem = LPS\nr,a,s\n1,2,3\n"),
            "p.csv:2: its columns contradict the coordinate system that a comment states");
  EXPECT_EQ(refusal("# units: cm\nx_mm,y_mm,z_mm\n1,2,3\n"),
            "p.csv: its columns contradict the unit that a comment states");
}

// A fourth number is no name, and a decimal comma separates nothing.
TEST_F(PointTableTest, NumbersWithoutAHeaderAreNotGuessed) {
  EXPECT_EQ(refusal("0.5,1,2,3\n").rfind("p.csv:1: \"0.5\" is no name: 4 numbers need a header", 0), 0U);
  for (const char *decimals : {"1,5,2,5,3,5\n", "A,1,5,2,5,3,5\n"}) {
    EXPECT_EQ(refusal(decimals).rfind("p.csv:1: has whole numbers where x,y,z and their errors are expected", 0), 0U);
  }
  EXPECT_NE(read("1,2,3,0.5,0.5,0.5\n")->notes[0].find("without a header its columns are taken as x, y, z, sx, sy, sz"),
            std::string::npos);
}

TEST_F(PointTableTest, WhetherAPointWasPlacedIsStatedInSeveralWays) {
  for (const char *no : {"0", "false", "FALSE", "no"}) {
    EXPECT_TRUE(read("label,r,a,s,defined\nA,0,0,0," + std::string(no) + "\n")->points.empty()) << no;
  }
  for (const char *yes : {"1", "true", "Yes"}) {
    EXPECT_EQ(read("label,r,a,s,defined\nA,0,0,0," + std::string(yes) + "\n")->points.size(), 1U) << yes;
  }
  EXPECT_EQ(refusal("label,r,a,s,defined\nB,1,2,3,1\nA,0,0,0,\n"),
            "p.csv:3: point A: defined = \"\": must be 1 or 0: was the point placed?");
}

TEST_F(PointTableTest, WithoutAHeaderTheNumberOfCellsDecides) {
  expect("1,2,3\n", p, "1");
  expect("A,1,2,3\n", p, "A");
  expect("+1,+2,+3\n4,5,6\n", p, "1");
  expect("Fiducial,1,2,3,Nz\n", p, "Nz");
  EXPECT_EQ(read("A,1,2,3\n", {.curves = true})->points[0].curve, "A");
  const auto errors = read("A,1,2,3,0.1,0.2,0.3\n");
  ASSERT_TRUE(errors);
  EXPECT_NEAR((*errors->points[0].covariance_mm2)(1, 1), 0.04, 1e-12);
}

TEST_F(PointTableTest, AStatedErrorTurnsWithTheSpace) {
  const auto table = read("name,l,p,s,cxx,cxy,cxz,cyy,cyz,czz\nA,-1,-2,3,4,1,2,5,0,6\n");
  ASSERT_TRUE(table) << table.error().message;
  Eigen::Matrix3d expected;
  expected << 4, 1, -2, 1, 5, 0, -2, 0, 6;
  EXPECT_TRUE(table->points[0].covariance_mm2->isApprox(expected));
  EXPECT_NEAR((*read("x,y,z,sigma [mm]\n1,2,3,0.5\n")->points[0].covariance_mm2)(2, 2), 0.25, 1e-12);
  EXPECT_NEAR((*read("x_cm,y_cm,z_cm,sigma_cm\n1,2,3,0.05\n")->points[0].covariance_mm2)(2, 2), 0.25, 1e-12);
  EXPECT_NEAR((*read("name,x,y,z,sigma\nA,1,2,3,0.5\n")->points[0].covariance_mm2)(2, 2), 0.25, 1e-12);
}

TEST_F(PointTableTest, WhatIsAssumedOrNotUsedIsSaid) {
  EXPECT_NE(read("1,2,3\n")->notes[0].find("the space of x, y, z is not stated: RAS is assumed"), std::string::npos);
  EXPECT_TRUE(read("r,a,s\n1,2,3\n")->notes.empty());
  EXPECT_TRUE(read("1,2,3\n", {.space = Space::kRas})->notes.empty());
  const auto unplaced = read("label,r,a,s,defined\nA,0,0,0,0\nB,1,2,3,1\n");
  ASSERT_EQ(unplaced->points.size(), 1U);
  EXPECT_NE(unplaced->notes[0].find(":2: \"A\" was never placed: it is left out"), std::string::npos);
}

// A copy that ended early may be one of "3.5".
TEST_F(PointTableTest, ANumberThatMayHaveBeenCutIsSaid) {
  EXPECT_TRUE(read("label,r,a,s\nA,1,2,3\n")->notes.empty());
  EXPECT_TRUE(read("r,a,s,label\n1,2,3,A")->notes.empty());
  for (const char *text : {"label,r,a,s\nA,1,2,3", "label,r,a,s\r\nA,1,2,3."}) {
    const auto table = read(text);
    ASSERT_TRUE(table && table->notes.size() == 1U) << text;
    EXPECT_NE(table->notes[0].find("p.csv:2: the last line does not end: digits of its last number may be missing"),
              std::string::npos)
        << table->notes[0];
  }
}

TEST_F(PointTableTest, WhatCannotBeReadIsRefusedByLineAndCell) {
  EXPECT_EQ(refusal("name,x,y,z,weight\nA,1,2,3,4\n"),
            "p.csv:1: column \"weight\" is not known; known are x y z, r a s, l p s, name, label, curve, sigma, sx sy "
            "sz and the columns of Slicer and ANTs");
  EXPECT_EQ(refusal("name,x,y\nA,1,2\n"), "p.csv:1: has no column z, s or i");
  EXPECT_EQ(refusal("name,x,r,y,z\nA,1,1,2,3\n"), "p.csv:1: the columns \"x\" and \"r\" mean the same");
  EXPECT_EQ(refusal("r,y,s\n1,2,3\n"), "p.csv:1: mixes columns x, y, z with columns that state their direction");
  EXPECT_EQ(refusal("x [mm],y [cm],z [mm]\n1,2,3\n"), "p.csv:1: column \"y [cm]\" has another unit than \"x [mm]\"");
  EXPECT_EQ(refusal("x,y,z [cm]\n1,2,3\n"), "p.csv:1: column \"z [cm]\" has another unit than \"x\"");
  EXPECT_EQ(refusal("x,y,z,sigma [um]\n1,2,3,400\n"), "p.csv:1: column \"sigma [um]\" has another unit than \"x\"");
  EXPECT_EQ(refusal("A,1,2,3\nB,1,2\n"), "p.csv:2: has 3 cells, there are 4 columns");
  EXPECT_EQ(refusal("A,1,2,inf\n"), "p.csv:1: point A: z = \"inf\": must be a finite number");
  EXPECT_EQ(
      refusal("A,1,2,\"1,234\"\nB,1.5,2,3\n"),
      "p.csv:1: point A: z = \"1,234\": must be a finite number, and it is not clear whether the comma begins its "
      "decimals");
  EXPECT_EQ(refusal("nothing,known,here,too\n1,2,3,4\n"),
            "p.csv:1: point nothing: x = \"known\": must be a finite number");
  EXPECT_EQ(refusal("A,1,2,3.5,0,1,1\n"), "p.csv:1: point A: its error must be positive in every direction");
}

} // namespace
} // namespace bregma::casefile
