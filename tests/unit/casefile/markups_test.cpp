#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "casefile/markups.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma::casefile;
using bregma::test::TemporaryFolder;

constexpr const char *kLps = "\"coordinateSystem\": \"LPS\",";

std::string points_file(const std::string &control_points, const std::string &fields = kLps,
                        const std::string &type = "Fiducial") {
  return "{\"markups\": [{\"type\": \"" + type + "\", " + fields + " \"controlPoints\": [" + control_points + "]}]}";
}

std::string markups_error(const std::string &content, const std::string &name = "f.mrk.json") {
  TemporaryFolder folder;
  const auto read = read_points(folder.write(name, content));
  const std::string message = read ? "no error" : read.error().message;
  const std::string prefix = (folder.path() / name).string();
  EXPECT_EQ(message.rfind(prefix, 0), 0U) << "the file is not named: " << message;
  return message.substr(std::min(message.size(), prefix.size()));
}

TEST(Markups, LpsAndRasBecomeRas) {
  TemporaryFolder folder;
  const std::string point = R"({"label": "F1", "position": [1.5, -2, 3], "positionStatus": "defined"})";
  for (const auto &[system, sign] : {std::pair("\"LPS\"", -1.0), {"\"RAS\"", 1.0}, {"1", -1.0}, {"0", 1.0}}) {
    const auto points = read_points(
        folder.write("f.mrk.json", points_file(point, "\"coordinateSystem\": " + std::string(system) + ",")));
    ASSERT_TRUE(points) << points.error().message;
    EXPECT_EQ(points->front().name, "F1");
    EXPECT_EQ(points->front().position_mm, Eigen::Vector3d(sign * 1.5, sign * -2.0, 3.0)) << system;
  }
}

TEST(Markups, PointsRoundTripToTheBit) {
  TemporaryFolder folder;
  const std::vector<NamedPoint> points{{"Nasion", {0.1, 1.0 / 3.0, -77.7}}, {"Äußerer \"Canthus\"", {-1e-9, 2e5, 0.0}}};
  const auto file = folder.path() / "fiducials.mrk.json";
  ASSERT_TRUE(write_points(file, "fiducials", points));
  const auto read = read_points(file);
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ((*read)[i].name, points[i].name);
    EXPECT_EQ((*read)[i].position_mm, points[i].position_mm);
  }
}

TEST(Markups, WrittenFilesAreWhatSlicerWrites) {
  TemporaryFolder folder;
  const auto file = folder.path() / "t.mrk.json";
  const std::vector<Trajectory> lines{{"Biopsy", {1, 2, 3}, {4, 5, 6}}};
  ASSERT_TRUE(write_trajectories(file, lines));
  const auto json = nlohmann::json::parse(bregma::tests::read_file(file));
  EXPECT_EQ(json["@schema"],
            "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/"
            "Schema/markups-schema-v1.0.3.json#");
  const auto &line = json["markups"][0];
  EXPECT_EQ(line["type"], "Line");
  EXPECT_EQ(line["coordinateSystem"], "LPS");
  EXPECT_EQ(line["coordinateUnits"], "mm");
  EXPECT_EQ(line["controlPoints"][1]["position"], (nlohmann::json{-4.0, -5.0, 6.0}));
  EXPECT_EQ(line["controlPoints"][1]["positionStatus"], "defined");
  const auto read = read_trajectories(file);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->front().name, "Biopsy");
  EXPECT_EQ(read->front().entry_mm, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(read->front().target_mm, Eigen::Vector3d(4, 5, 6));
}

TEST(Markups, ErrorsNameTheControlPointAndTheValue) {
  EXPECT_EQ(
      markups_error(points_file(R"({"label": "A", "position": [1, 2, 3]}, {"label": "B", "position": [1, 2, null]})")),
      ": markup 1, control point 2 (B): position = [1,2,null]: must be three numbers");
  EXPECT_EQ(markups_error(points_file(R"({"label": "A", "position": [1, 2]})")),
            ": markup 1, control point 1 (A): position = [1,2]: must be three numbers");
  EXPECT_EQ(markups_error(points_file(R"({"label": " "})")), ": markup 1, control point 1: has no position");
  EXPECT_EQ(
      markups_error(points_file(R"({"label": "A", "position": [0, 0, 0], "positionStatus": "undefined"})")),
      ": markup 1, control point 1 (A): positionStatus = \"undefined\": it was never placed: place it, or delete it");
  EXPECT_EQ(markups_error(points_file("", "\"coordinateSystem\": \"XYZ\",")),
            ": markup 1: coordinateSystem = \"XYZ\": must be LPS or RAS");
  EXPECT_EQ(markups_error(points_file("", "", "Plane")),
            ": markup 1: type = \"Plane\": only Fiducial, Line, Curve and ClosedCurve are read");
  EXPECT_EQ(markups_error(points_file("", std::string(kLps) + "\"coordinateUnits\": \"inch\",")),
            ": markup 1: coordinateUnits = \"inch\": must be mm, cm, m or um");
  EXPECT_EQ(markups_error("{}"), ": is not a Slicer markups file: it has no list \"markups\"");
  EXPECT_EQ(markups_error("[1, 2]"), ": is not a Slicer markups file: it has no list \"markups\"");
  EXPECT_EQ(markups_error("{\"markups\": [3]}"), ": markup 1: is not a markup");
  EXPECT_EQ(markups_error("{\n\"markups\": ["), ":2: is not whole: its JSON ends within a value");
  EXPECT_NE(markups_error(points_file(R"({"label": "A", "position": [NaN, 0, 0]})")).find("is not JSON: \""),
            std::string::npos)
      << markups_error(points_file(R"({"label": "A", "position": [NaN, 0, 0]})"));
  EXPECT_NE(markups_error(points_file(R"({"label": "A", "position": [1e999, 0, 0]})")).find("f.mrk.json"), 0U);
}

TEST(Markups, LinesAndPointsAreNotTakenForEachOther) {
  TemporaryFolder folder;
  const std::string two = R"({"position": [1, 2, 3]}, {"position": [4, 5, 6]})";
  const auto line = folder.write("My line.mrk.json", points_file(two, kLps, "Line"));
  EXPECT_NE(read_points(line).error().message.find("is a line where points are expected"), std::string::npos);
  EXPECT_EQ(read_trajectories(line)->front().name, "My line");
  const auto three = folder.write("l.mrk.json", points_file(two + R"(, {"position": [4, 5, 6]})", kLps, "Line"));
  EXPECT_NE(read_trajectories(three).error().message.find("a line has two control points, this one has 3"),
            std::string::npos);
  EXPECT_FALSE(read_points(folder.path() / "absent.mrk.json"));
}

TEST(Markups, FcsvIsRead) {
  TemporaryFolder folder;
  const std::string header = "# Markups fiducial file version = 4.10\n# CoordinateSystem = 0\n"
                             "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n";
  const auto points = read_points(
      folder.write("a.fcsv", header + "vtk_1,0.832,5.670,-9.659,0,0,0,1,1,1,0,AC,the front one,vtkMRML1\n"));
  ASSERT_TRUE(points) << points.error().message;
  EXPECT_EQ(points->front().name, "AC");
  EXPECT_EQ(points->front().position_mm, Eigen::Vector3d(0.832, 5.670, -9.659));
  EXPECT_EQ(markups_error(header + "vtk_1,0.832,five,-9.659,0,0,0,1,1,1,0,AC,,\n", "b.fcsv"),
            ":4: control point 1 (AC): y = five: must be a finite number");
  EXPECT_EQ(markups_error("# CoordinateSystem = 7\n", "c.fcsv"),
            ":1: CoordinateSystem = 7: must be LPS or RAS (1 or 0)");
}

// As in two files that were joined.
TEST(Markups, AnFcsvThatStatesTwoThingsIsRefused) {
  const std::string header = "# CoordinateSystem = LPS\n# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label\n";
  const std::string row = "vtk_1,1,2,3,0,0,0,1,1,1,0,A\n";
  TemporaryFolder folder;
  EXPECT_TRUE(read_points(folder.write("a.fcsv", header + row + header + row)));
  EXPECT_EQ(markups_error(header + row + "# CoordinateSystem = RAS\n" + row, "a.fcsv"),
            ":4: CoordinateSystem = RAS: is stated before as another one");
  EXPECT_EQ(markups_error(header + row + "# columns = id,y,x,z\n" + row, "a.fcsv"),
            ":4: the columns are stated before in another way");
}

TEST(Markups, UnitsOfAnyFormAreApplied) {
  TemporaryFolder folder;
  for (const char *unit :
       {"\"m\"", "[\"m\", \"UCUM\", \"meter\"]", "{\"codeValue\": \"m\", \"codingSchemeDesignator\": \"UCUM\"}"}) {
    const auto points =
        read_points(folder.write("u.mrk.json", points_file(R"({"label": "A", "position": [-0.01, -0.02, 0.03]})",
                                                           std::string(kLps) + "\"coordinateUnits\": " + unit + ",")));
    ASSERT_TRUE(points) << points.error().message;
    EXPECT_TRUE(points->front().position_mm.isApprox(Eigen::Vector3d(10, 20, 30))) << unit;
  }
}

TEST(Markups, WhatCannotBeUsedBesideAListIsLeftOutAndSaid) {
  TemporaryFolder folder;
  const auto file = folder.write("b.mrk.json", R"({"markups": [{"type": "Plane", "controlPoints": []},
      {"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm",
       "controlPoints": [{"label": "A", "position": [0, 0, 0]},
        {"label": "B", "position": [0, 0, 0], "positionStatus": "preview"}]},
      {"type": "Line", "name": "L", "coordinateSystem": "LPS", "coordinateUnits": "mm",
       "controlPoints": [{"position": [0, 0, 0]}, {"position": [0, 0, 1]}]}]})");
  Notes notes;
  const auto points = read_points(file, &notes);
  ASSERT_TRUE(points) << points.error().message;
  EXPECT_EQ(points->size(), 1U);
  ASSERT_EQ(notes.size(), 3U);
  EXPECT_NE(notes[0].find("control point 2 (B): positionStatus = \"preview\": it was never placed: it is left out"),
            std::string::npos);
  EXPECT_NE(notes[1].find("markup 1: type = \"Plane\": it is left out"), std::string::npos);
  EXPECT_NE(notes[2].find("\"L\" is a line where points are expected: it is left out"), std::string::npos);
  EXPECT_FALSE(read_points(file)) << "a reader that tells nobody refuses the file";
}

TEST(Markups, ASpaceThatIsNotStatedIsSaid) {
  TemporaryFolder folder;
  const std::string row = "vtk_1,1,2,3,0,0,0,1,1,1,0,AC,,\n";
  for (const auto &[file, assumed] :
       {std::pair(folder.write("a.mrk.json", points_file(R"({"label": "A", "position": [-1, -2, 3]})", "")), "LPS"),
        {folder.write("a.fcsv", row), "RAS"}}) {
    Notes notes;
    const auto points = read_points(file, &notes);
    ASSERT_TRUE(points) << points.error().message;
    EXPECT_EQ(points->front().position_mm, Eigen::Vector3d(1, 2, 3));
    ASSERT_FALSE(notes.empty());
    EXPECT_NE(notes[0].find("is not stated: " + std::string(assumed) + " is assumed"), std::string::npos) << notes[0];
    EXPECT_FALSE(read_points(file)) << "a reader that prints no notes";
  }
}

TEST(Markups, AUnitThatIsNotStatedIsSaid) {
  TemporaryFolder folder;
  Notes notes;
  const auto file = folder.write("a.mrk.json", points_file(R"({"label": "A", "position": [-1, -2, 3]})"));
  const auto points = read_points(file, &notes);
  ASSERT_TRUE(points) << points.error().message;
  EXPECT_EQ(points->front().position_mm, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(notes, Notes{file.string() + ": markup 1: its coordinateUnits are not stated: mm is assumed"});
  notes.clear();
  const std::string stated = std::string(kLps) + "\"coordinateUnits\": \"mm\",";
  ASSERT_TRUE(read_points(folder.write("b.mrk.json", points_file("", stated)), &notes));
  EXPECT_EQ(notes, Notes{});
}

TEST(Markups, WhatIsNotStatedCanBeGiven) {
  TemporaryFolder folder;
  const std::string point = R"({"label": "A", "position": [0.01, 0.02, 0.03]})";
  const MarkupDefaults given{Space::kRas, LengthUnit::kMetre};
  const auto bare = folder.write("a.mrk.json", points_file(point, ""));
  Notes notes;
  const auto read = read_points(bare, &notes, given);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_TRUE(read->front().position_mm.isApprox(Eigen::Vector3d(10, 20, 30)));
  ASSERT_EQ(notes.size(), 2U);
  EXPECT_NE(notes[0].find("RAS is assumed"), std::string::npos) << notes[0];
  EXPECT_NE(notes[1].find("m is assumed"), std::string::npos) << notes[1];
  notes.clear();
  const auto stating =
      folder.write("b.mrk.json", points_file(point, std::string(kLps) + "\"coordinateUnits\": \"cm\","));
  const auto stated = read_points(stating, &notes, given);
  ASSERT_TRUE(stated) << stated.error().message;
  EXPECT_TRUE(stated->front().position_mm.isApprox(Eigen::Vector3d(-0.1, -0.2, 0.3)));
  EXPECT_TRUE(notes.empty());
  const auto old = read_points(folder.write("a.fcsv", "vtk_1,1,2,3,0,0,0,1,1,1,0,AC,,\n"), &notes, {Space::kLps, {}});
  ASSERT_TRUE(old) << old.error().message;
  EXPECT_EQ(old->front().position_mm, Eigen::Vector3d(-1, -2, 3));
}

TEST(Markups, ALabelOfNullIsNone) {
  TemporaryFolder folder;
  const auto points = read_points(folder.write("a.mrk.json", points_file(R"({"label": null, "position": [1, 2, 3]},
                                                            {"label": 7, "position": [4, 5, 6]})")));
  ASSERT_TRUE(points) << points.error().message;
  EXPECT_EQ(points->front().name, "");
  EXPECT_EQ(points->back().name, "7");
}

TEST(Markups, AKeyThatIsStatedTwiceIsRefused) {
  const std::string point = R"({"label": "A", "position": [1, 2, 3]})";
  EXPECT_EQ(markups_error(points_file(point, "\"coordinateSystem\": \"LPS\", \"coordinateSystem\": \"RAS\",")),
            ": the key \"coordinateSystem\" is stated twice in one place");
  TemporaryFolder folder;
  EXPECT_TRUE(read_points(folder.write("two.mrk.json", points_file(point + ", " + point)))) << "of two points";
}

TEST(Markups, ATableOrARowThatWasCutIsRefusedByName) {
  EXPECT_EQ(markups_error("name,x,y,z\nA,1,2,3\n", "a.csv"),
            ": is a table; Slicer's lists are read here, .mrk.json or .fcsv");
  const std::string header = "# CoordinateSystem = LPS\n# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc\n";
  EXPECT_EQ(markups_error(header + "vtk_1,1,2,3,0,0,0,1,1,1,0,AC,\nvtk_2,1,2,30,0,0,0", "a.fcsv"),
            ":4: control point 2: the row has 7 cells, 13 columns are stated: it is not whole");
}

// CT and MR of a distortion phantom, from Slicer.
TEST(Markups, RealFilesOfSlicer) {
  BREGMA_SHARED_DATA(folder, "distortion");
  const auto ct = read_points(folder / "CT.mrk.json");
  ASSERT_TRUE(ct) << ct.error().message;
  std::printf("CT.mrk.json: %zu points, the first at R %.2f A %.2f S %.2f\n", ct->size(), ct->front().position_mm.x(),
              ct->front().position_mm.y(), ct->front().position_mm.z());
  EXPECT_EQ(ct->front().position_mm, Eigen::Vector3d(15.87, 90.26, -2.42)) << "LPS (-15.87, -90.26, -2.42)";
  TemporaryFolder temporary;
  for (const char *name :
       {"CT.mrk.json", "MR.mrk.json", "repeat/CT.mrk.json", "repeat/MR_AP.mrk.json", "repeat/MR_PA.mrk.json"}) {
    const auto points = read_points(folder / name);
    ASSERT_TRUE(points) << points.error().message;
    EXPECT_GT(points->size(), 250U) << name;
    const auto copy = temporary.path() / "copy.mrk.json";
    ASSERT_TRUE(write_points(copy, "copy", *points));
    const auto again = read_points(copy);
    ASSERT_TRUE(again);
    ASSERT_EQ(again->size(), points->size());
    for (std::size_t i = 0; i < points->size(); ++i) {
      EXPECT_EQ((*again)[i].position_mm, (*points)[i].position_mm) << name << " " << i;
    }
  }
}

TEST(Markups, RealFcsvFiles) {
  BREGMA_SHARED_DATA(folder, "fiducials/afids_hcp/derivatives/afids_rater");
  int files = 0;
  for (const auto &entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".fcsv") {
      continue;
    }
    const auto points = read_points(entry.path());
    ASSERT_TRUE(points) << points.error().message;
    EXPECT_EQ(points->size(), 32U) << entry.path();
    ++files;
  }
  EXPECT_GT(files, 80);
}

} // namespace
