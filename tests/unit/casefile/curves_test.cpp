#include <gtest/gtest.h>

#include "casefile/markups.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma::casefile;
using bregma::test::TemporaryFolder;
using Eigen::Vector3d;

std::string slicer_curve(const std::string &type, const std::string &name, const std::string &points) {
  return R"({"markups": [{"type": ")" + type + R"(", "name": ")" + name +
         R"(", "coordinateSystem": "LPS", "controlPoints": [)" + points + "]}]}";
}

const std::string kThree = R"({"position": [-1, -2, 3]}, {"position": [-4, -5, 6]}, {"position": [-7, -8, 10]})";

std::string curves_error(const std::string &name, const std::string &content) {
  const TemporaryFolder folder;
  const auto read = read_curves(folder.write(name, content));
  const std::string message = read ? "no error" : read.error().message;
  return message.substr(std::min(message.size(), message.find(name)));
}

TEST(Curves, SlicersCurvesClosedCurvesAndLinesBecomeRas) {
  const TemporaryFolder folder;
  for (const auto &[type, closed] : {std::pair("Curve", false), {"ClosedCurve", true}}) {
    const auto read = read_curves(folder.write("sulcus.mrk.json", slicer_curve(type, "Central", kThree)));
    ASSERT_TRUE(read) << read.error().message;
    ASSERT_EQ(read->size(), 1U);
    EXPECT_EQ(read->front().name, "Central");
    EXPECT_EQ(read->front().closed, closed);
    EXPECT_EQ(read->front().points_mm, (std::vector<Vector3d>{{1, 2, 3}, {4, 5, 6}, {7, 8, 10}}));
  }
  const auto line = read_curves(folder.write(
      "midline.mrk.json", slicer_curve("Line", "", R"({"position": [0, 0, 0]}, {"position": [0, 0, 5]})")));
  ASSERT_TRUE(line) << line.error().message;
  EXPECT_EQ(line->front().name, "midline");
  EXPECT_EQ(line->front().points_mm.size(), 2U);
}

TEST(Curves, ATableHoldsSeveralInAnyOrderOfRows) {
  const TemporaryFolder folder;
  const auto read =
      read_curves(folder.write("c.csv", "curve,x,y,z\nA,0,0,0\nB,1,1,1\nA,10,0,0\n# remark\nB,2,2,2\nA,10,10,0\n"
                                        "A,0,10,0\nA,0,0,0\n"));
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->size(), 2U);
  EXPECT_EQ((*read)[0].name, "A");
  EXPECT_TRUE((*read)[0].closed);
  EXPECT_EQ((*read)[0].points_mm.size(), 4U) << "the first point is not repeated";
  EXPECT_FALSE((*read)[1].closed);
  EXPECT_EQ((*read)[1].points_mm, (std::vector<Vector3d>{{1, 1, 1}, {2, 2, 2}}));
}

TEST(Curves, ErrorsAreReportedWithTheirPlace) {
  EXPECT_EQ(curves_error("c.csv", "A,0,0,0\nA,1,nan,0\n"), "c.csv:2: point 2: y = \"nan\": must be a finite number");
  EXPECT_EQ(curves_error("c.csv", "A,0,0,0\nA,1,0\n"), "c.csv:2: has 3 cells, there are 4 columns");
  EXPECT_EQ(curves_error("c.csv", "A,0,0,0\n"), "c.csv: curve \"A\": has 1 points, a curve has at least 2");
  EXPECT_EQ(curves_error("c.csv", "A,0,0,0\nA,1,0,0\nA,1,0,0\n"), "c.csv: curve \"A\": points 2 and 3 are the same");
  EXPECT_EQ(curves_error("c.csv", "curve,x,y,z\n"), "c.csv: holds no curve");
  EXPECT_EQ(curves_error("c.mrk.json", slicer_curve("Fiducial", "F", kThree)),
            "c.mrk.json: \"F\" is a list of points where curves are expected");
  EXPECT_EQ(curves_error("c.mrk.json",
                         slicer_curve("ClosedCurve", "Rim", R"({"position": [0, 0, 0]}, {"position": [0, 0, 5]})")),
            "c.mrk.json: curve \"Rim\": has 2 points, a closed curve has at least 3");
  EXPECT_EQ(read_curves("/nowhere/c.csv").error().message, "/nowhere/c.csv: No such file or directory");
}

} // namespace
