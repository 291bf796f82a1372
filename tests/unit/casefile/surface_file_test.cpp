// Surfaces of other programs: VTK's writers, FreeSurfer's format, real files; and faulty files.
#include "casefile/surface_files/surface_file.hpp"

#include <algorithm>
#include <bit>
#include <cctype>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "casefile/mesh_file.hpp"
#include "casefile/ply.hpp"
#include "casefile/surface_files/raw_surface.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace {

using namespace bregma::casefile;
using bregma::surface::TriangleMesh;
using bregma::test::TemporaryFolder;
using Eigen::Vector3d;

// A tetrahedron of 100 mm width that changes if two axes are exchanged, as text.
const char *const kFreeSurferText = "#!ascii version of lh.skin\n4 4\n0 0 0 0\n100 0 0 0\n0 70 0 0\n0 0 50 0\n"
                                    "0 2 1 0\n0 1 3 0\n0 3 2 0\n1 2 3 0\n";
const char *const kStlText = R"(solid skin
facet normal 0 0 -1
 outer loop
  vertex 0 0 0
  vertex 0 70 0
  vertex 100 0 0
 endloop
endfacet
facet normal nan nan nan
 outer loop
  vertex 0 0 0
  vertex 100 0 0
  vertex 0 0 50
 endloop
endfacet
endsolid
)";
const char *const kVtkText =
    "# vtk DataFile Version 4.2\nskin\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n0 0 0 100 0 0\n"
    "0 70 0 0 0 50\nPOLYGONS 4 16\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\nPOINT_DATA 4\n";

std::string replaced(std::string text, const std::string &from, const std::string &to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

// The message without the folder; "no error" on success.
std::string error_of(const std::string &name, const std::string &content, const SurfaceReadOptions &options = {}) {
  const TemporaryFolder folder;
  const auto read = read_surface(folder.write(name, content), options);
  return read ? "no error" : replaced(read.error().message, (folder.path() / "").string(), "");
}

std::string big_endian(std::uint32_t value) {
  std::string out(4, '\0');
  for (unsigned i = 0; i < 4; ++i) {
    out[i] = static_cast<char>(value >> (24U - 8U * i));
  }
  return out;
}
std::string big_endian(float value) { return big_endian(std::bit_cast<std::uint32_t>(value)); }

std::string freesurfer_binary(const TriangleMesh &mesh, const std::string &footer = "") {
  std::string out = "\xFF\xFF\xFE"
                    "created by test\n\n";
  out += big_endian(static_cast<std::uint32_t>(mesh.vertices_mm.size()));
  out += big_endian(static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const Vector3d &v : mesh.vertices_mm) {
    for (const double x : v) {
      out += big_endian(static_cast<float>(x));
    }
  }
  for (const auto &t : mesh.triangles) {
    for (const int corner : t) {
      out += big_endian(static_cast<std::uint32_t>(corner));
    }
  }
  return out + footer;
}

std::string binary_stl(const std::string &header, const std::vector<float> &coordinates, std::uint32_t claimed) {
  std::string out = header;
  out.resize(80, ' ');
  out.append(reinterpret_cast<const char *>(&claimed), 4); // NOLINT(cppcoreguidelines-pro-type-reinterpret-cast)
  for (std::size_t i = 0; i + 8 < coordinates.size(); i += 9) {
    out.append(12, '\0');
    out.append(reinterpret_cast<const char *>(&coordinates[i]),
               36); // NOLINT(cppcoreguidelines-pro-type-reinterpret-cast)
    out.append(2, '\0');
  }
  return out;
}

const std::vector<float> kTwoTriangles{0, 0, 0, 0, 70, 0, 100, 0, 0, 0, 0, 0, 100, 0, 0, 0, 0, 50};

TEST(SurfaceFile, WhatIsAssumedWhereAFileDoesNotTellItsSpace) {
  const TemporaryFolder folder;
  const auto read = [&](const std::string &name, const std::string &content, const SurfaceReadOptions &options = {}) {
    auto out = read_surface(folder.write(name, content), options);
    EXPECT_TRUE(out) << out.error().message;
    EXPECT_FALSE(out->space_stated) << name;
    return *out;
  };
  const SurfaceFile freesurfer = read("lh.asc", kFreeSurferText);
  EXPECT_EQ(freesurfer.space, Space::kRas);
  EXPECT_EQ(freesurfer.mesh.vertices_mm[1], Vector3d(100, 0, 0));
  EXPECT_EQ(freesurfer.format, "FreeSurfer");
  for (const auto &[name, content] : {std::pair("a.stl", kStlText), {"a.vtk", kVtkText}}) {
    const SurfaceFile lps = read(name, content);
    EXPECT_EQ(lps.space, Space::kLps);
    EXPECT_EQ(std::count(lps.mesh.vertices_mm.begin(), lps.mesh.vertices_mm.end(), Vector3d(-100, 0, 0)), 1) << name;
    EXPECT_EQ(std::count(lps.mesh.vertices_mm.begin(), lps.mesh.vertices_mm.end(), Vector3d(0, -70, 0)), 1) << name;
    SurfaceReadOptions ras;
    ras.space = Space::kRas;
    const SurfaceFile as_ras = read(name, content, ras);
    EXPECT_EQ(std::count(as_ras.mesh.vertices_mm.begin(), as_ras.mesh.vertices_mm.end(), Vector3d(100, 0, 0)), 1);
  }
}

TEST(SurfaceFile, WhatAFileStatesHoldsAgainstTheCaller) {
  const TemporaryFolder folder;
  SurfaceReadOptions says_lps;
  says_lps.space = Space::kLps;
  for (const auto &[name, content] :
       {std::pair<std::string, std::string>("a.stl", replaced(kStlText, "solid skin", "solid SPACE=RAS")),
        {"b.stl", binary_stl("3D Slicer output. SPACE=RAS", kTwoTriangles, 2)},
        {"a.vtk", replaced(kVtkText, "\nskin", "\n3D Slicer output. SPACE=RAS")},
        {"a.ply", "ply\nformat ascii 1.0\ncomment SPACE=RAS\nelement vertex 3\nproperty float x\nproperty float y\n"
                  "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
                  "0 0 0\n100 0 0\n0 70 0\n3 0 1 2\n"}}) {
    const auto read = read_surface(folder.write(name, content), says_lps);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_TRUE(read->space_stated) << name;
    EXPECT_EQ(read->space, Space::kRas) << name;
    EXPECT_EQ(std::count(read->mesh.vertices_mm.begin(), read->mesh.vertices_mm.end(), Vector3d(100, 0, 0)), 1) << name;
  }
  EXPECT_EQ(error_of("a.vtk", replaced(kVtkText, "\nskin", "\nSPACE=RAS SPACE=LPS")),
            "a.vtk: states both SPACE=LPS and SPACE=RAS");
  EXPECT_EQ(error_of("a.vtk", replaced(kVtkText, "\nskin", "\nSPACE=LAS")), "a.vtk: SPACE=LAS: must be RAS or LPS");
  EXPECT_EQ(error_of("a.vtk", replaced(kVtkText, "\nskin", "\nCOLORSPACE=sRGB SPACE=RAS")), "no error");
}

TEST(SurfaceFile, BregmasOwnFilesAreRas) {
  const TemporaryFolder folder;
  const TriangleMesh mesh = bregma::tests::sphere({10, -20, 30}, 80);
  ASSERT_TRUE(write_mesh(folder.path() / "ours.ply", mesh));
  const auto read = read_surface(folder.path() / "ours.ply");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_TRUE(read->space_stated);
  EXPECT_LT((read->mesh.vertices_mm[0] - Vector3d(90, -20, 30)).norm(), 1e-4);
}

TEST(SurfaceFile, CornersOfStlBecomeSharedVertices) {
  const TemporaryFolder folder;
  for (const auto &file : {folder.write("a.stl", kStlText), folder.write("b.stl", binary_stl("x", kTwoTriangles, 2)),
                           folder.write("c.stl", binary_stl("solid but binary", kTwoTriangles, 2))}) {
    const auto read = read_surface(file);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->mesh.vertices_mm.size(), 4U) << file;
    EXPECT_EQ(read->mesh.triangles.size(), 2U) << file;
  }
  // A degenerate triangle is dropped.
  std::vector<float> with_line = kTwoTriangles;
  with_line.insert(with_line.end(), {0, 0, 0, 0, 0, 0, 100, 0, 0});
  const auto read = read_surface(folder.write("d.stl", binary_stl("x", with_line, 3)));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->triangles_left_out, 1U);
  EXPECT_EQ(read->mesh.triangles.size(), 2U);
}

TEST(SurfaceFile, FreeSurferBinaryIsMovedToScannerRasByItsFooter) {
  const TemporaryFolder folder;
  const TriangleMesh mesh = bregma::tests::sphere({10, 20, 30}, 80);
  const auto first_vertex = [&](const std::string &footer) {
    const auto read = read_surface(folder.write("lh.skin", freesurfer_binary(mesh, footer)));
    EXPECT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->mesh.triangles.size(), mesh.triangles.size());
    return read ? Vector3d(read->mesh.vertices_mm[0]) : Vector3d::Zero();
  };
  const std::string geometry = "valid = 1  # volume info valid\nfilename = T1.mgz\nvolume = 256 256 256\n"
                               "voxelsize = 1 1 1\nxras = -1 0 0\nyras = 0 0 -1\nzras = 0 1 0\ncras = 5.5 -17 8\n";
  EXPECT_LT((first_vertex("") - Vector3d(90, 20, 30)).norm(), 1e-4);
  const std::string coordinates = big_endian(2U) + big_endian(0U);
  EXPECT_LT((first_vertex(coordinates + big_endian(20U) + geometry) - Vector3d(95.5, 3, 38)).norm(), 1e-4);
  // Geometry of a volume scanned with the head turned to the side: i runs down, j to the right.
  const std::string turned =
      replaced(replaced(geometry, "xras = -1 0 0", "xras = 0 0 -1"), "yras = 0 0 -1", "yras = 1 0 0");
  EXPECT_LT((first_vertex(big_endian(20U) + turned) - Vector3d(-30 + 5.5, 20 - 17, 90 + 8)).norm(), 1e-4);
  EXPECT_LT(
      (first_vertex(big_endian(20U) + replaced(geometry, "valid = 1", "valid = 0")) - Vector3d(90, 20, 30)).norm(),
      1e-4);
  // Coordinates that are already scanner RAS do not change.
  EXPECT_LT((first_vertex(big_endian(2U) + big_endian(1U) + big_endian(20U) + geometry) - Vector3d(90, 20, 30)).norm(),
            1e-4);
  // An option does not change what the footer states.
  const auto stated = read_surface(folder.write("lh.skin", freesurfer_binary(mesh, big_endian(20U) + geometry)),
                                   {.space = Space::kLps});
  ASSERT_TRUE(stated) << stated.error().message;
  EXPECT_TRUE(stated->space_stated);
  EXPECT_LT((stated->mesh.vertices_mm[0] - Vector3d(95.5, 3, 38)).norm(), 1e-4);
  const auto bad = error_of("lh.skin", freesurfer_binary(mesh, big_endian(20U) + replaced(geometry, "5.5", "nan")));
  EXPECT_NE(bad.find("volume geometry: cras: x = \"nan\": must be a finite number"), std::string::npos) << bad;
}

TEST(SurfaceFile, WrongUnitsAreRefusedWithTheWidthAndAdvice) {
  const TemporaryFolder folder;
  const auto error_at = [&](double scale, const SurfaceReadOptions &options) {
    TriangleMesh mesh = bregma::tests::sphere({0, 0, 0}, 100.0 * scale);
    const auto file = folder.path() / "head.ply";
    EXPECT_TRUE(write_mesh(file, mesh));
    const auto read = read_surface(file, options);
    return read ? "no error" : replaced(read.error().message, (folder.path() / "").string(), "");
  };
  SurfaceReadOptions options;
  options.unit_option = "--units";
  EXPECT_EQ(error_at(0.001, options),
            "head.ply: the surface is 0.2 mm wide, at least 40 mm is taken: if the file is in "
            "metres, say --units m");
  EXPECT_EQ(error_at(0.1, options), "head.ply: the surface is 20 mm wide, at least 40 mm is taken: if the file is in "
                                    "centimetres, say --units cm");
  EXPECT_EQ(error_at(100.0, options), "head.ply: the surface is 20000 mm wide, at most 1000 mm is taken");
  EXPECT_EQ(error_at(1000.0, options),
            "head.ply: the surface is 200000 mm wide, at most 1000 mm is taken: if the file is "
            "in micrometres, say --units um");
  EXPECT_EQ(error_at(1.0, options), "no error");
  options.unit = LengthUnit::kMetre;
  EXPECT_EQ(error_at(0.001, options), "no error");
  EXPECT_EQ(error_at(1.0, options),
            "head.ply: the surface is 200000 mm wide, at most 1000 mm is taken: if the file is in "
            "millimetres, say --units mm");
  const auto metres =
      read_surface(folder.write("m.asc", "#!ascii\n3 1\n0 0 0 0\n0.1 0 0 0\n0 0.1 0 0\n0 1 2 0\n"), options);
  ASSERT_TRUE(metres);
  EXPECT_LT((metres->mesh.vertices_mm[1] - Vector3d(100, 0, 0)).norm(), 1e-9);
}

TEST(SurfaceFile, AnObjWithTabsLosesNoLine) {
  const auto blanks = detail::parse_surface("v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 2 3\nf 1 2 4\n", "a.obj");
  const auto tabs = detail::parse_surface("v\t0\t0\t0\nv\t9\t0\t0\nv\t0 9 0\nv 0 0 9\nf\t1 2 3\nf\t1\t2\t4\n", "a.obj");
  ASSERT_TRUE(blanks && tabs);
  EXPECT_EQ(tabs->mesh.triangles, blanks->mesh.triangles);
  EXPECT_EQ(tabs->mesh.vertices_mm, blanks->mesh.vertices_mm);
}

TEST(SurfaceFile, WrongTextsAreRefusedWithLineAndValue) {
  const std::string fs = kFreeSurferText;
  EXPECT_EQ(error_of("a.asc", replaced(fs, "100 0 0 0", "100 nan 0 0")),
            "a.asc:4: vertex 1: y = \"nan\": must be a finite number");
  EXPECT_EQ(error_of("a.asc", replaced(fs, "1 2 3 0", "1 2 4 0")),
            "a.asc:10: triangle 3: corner = \"4\": must be a vertex, 0 to 3");
  EXPECT_EQ(error_of("a.asc", fs.substr(0, fs.size() - 6)), "a.asc:10: the file ends before triangle 3");
  EXPECT_EQ(error_of("a.asc", replaced(fs, "4 4", "4000 4")),
            "a.asc:2: number of vertices = 4000: the file is too short for this number");
  EXPECT_EQ(error_of("a.asc", replaced(fs, "4 4", "-4 4")),
            "a.asc:2: number of vertices = \"-4\": must be a whole number");

  const std::string stl = kStlText;
  EXPECT_EQ(error_of("a.stl", replaced(stl, "vertex 0 70 0", "vertex 0 inf 0")),
            "a.stl:5: triangle 0: corner 1: y = \"inf\": must be a finite number");
  EXPECT_EQ(error_of("a.stl", stl.substr(0, stl.find("endloop\nendfacet\nendsolid"))),
            "a.stl:14: the file ends where \"endloop\" must stand");
  EXPECT_EQ(error_of("a.stl", replaced(stl, "outer loop", "outer lop")), "a.stl:3: \"lop\" where \"loop\" is expected");
  EXPECT_EQ(error_of("a.stl", "solid nothing\nendsolid\n"),
            "a.stl: the mesh is empty: it has 0 vertices and no triangle");

  const std::string vtk = kVtkText;
  EXPECT_EQ(error_of("a.vtk", replaced(vtk, "0 70 0", "0 x 0")),
            "a.vtk:7: POINTS: number 7 = \"x\": must be a finite number");
  EXPECT_EQ(error_of("a.vtk", replaced(vtk, "3 1 2 3", "3 1 2 99")),
            "a.vtk:8: triangle 3: corner = 99: must be a vertex, 0 to 3");
  EXPECT_EQ(error_of("a.vtk", replaced(vtk, "POLYGONS 4 16\n3 0 2 1\n3 0 1 3", "POLYGONS 4 16\n2 0 2 1\n3 0 1 3")),
            "a.vtk:8: cell 2 ends after the section does");
  EXPECT_EQ(error_of("a.vtk", vtk.substr(0, vtk.find("0 0 50"))), "a.vtk:7: the file ends before POINTS: number 9");
  EXPECT_EQ(error_of("a.vtk", replaced(vtk, "POLYDATA", "UNSTRUCTURED_GRID")),
            "a.vtk:4: the dataset is \"UNSTRUCTURED_GRID\", only POLYDATA is read");
  EXPECT_EQ(error_of("a.vtk", vtk.substr(0, vtk.find("POLYGONS"))),
            "a.vtk: the mesh is empty: it has 4 vertices and no triangle");
}

TEST(SurfaceFile, WrongBytesAreRefusedWithTheirPlace) {
  std::vector<float> with_nan = kTwoTriangles;
  with_nan[10] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(error_of("a.stl", binary_stl("x", with_nan, 2)),
            "a.stl: byte 150: triangle 1: corner 0: y = nan: must be a finite number");
  EXPECT_EQ(error_of("a.stl", binary_stl("x", kTwoTriangles, 7)), "a.stl: byte 184: the file ends in triangle 2 of 7");
  EXPECT_EQ(error_of("a.stl", "short"), "a.stl: byte 5: the file ends within its header of 84 bytes");
  EXPECT_EQ(error_of("a.stl", binary_stl("x", {}, 0)), "a.stl: the mesh is empty: it has 0 vertices and no triangle");

  TriangleMesh mesh = bregma::tests::sphere({0, 0, 0}, 80, 1);
  const std::string whole = freesurfer_binary(mesh);
  EXPECT_EQ(error_of("lh.skin", whole.substr(0, whole.size() - 1)),
            "lh.skin: byte " + std::to_string(whole.size() - 1) +
                ": the file ends before its 18 vertices and 32 triangles do");
  mesh.triangles[2][1] = 18;
  EXPECT_EQ(error_of("lh.skin", freesurfer_binary(mesh)), "lh.skin: byte " + std::to_string(28 + 18 * 12 + 2 * 12 + 4) +
                                                              ": triangle 2: corner = 18: must be a vertex, 0 to 17");
  EXPECT_EQ(error_of("notes.txt", "hello"),
            "notes.txt: is not a surface that is read: PLY, STL, OBJ, VTK (.vtk, .vtp), GIFTI or FreeSurfer");
  EXPECT_EQ(read_surface("/nowhere/a.stl").error().message, "/nowhere/a.stl: No such file or directory");
}

// As whole slices behind those of an image: the header is that of another surface.
TEST(SurfaceFile, MoreThanTheHeaderStatesIsRefused) {
  EXPECT_NE(error_of("a.stl", binary_stl("x", kTwoTriangles, 1)).find("holds 1 triangles more than its header states"),
            std::string::npos);
  const std::string fs = kFreeSurferText;
  EXPECT_NE(error_of("a.asc", replaced(fs, "4 4", "4 3")).find("follows the triangles that it states"),
            std::string::npos);
  const std::string ply = detail::to_ply(bregma::tests::sphere({0, 0, 0}, 80, 1));
  EXPECT_NE(error_of("a.ply", replaced(ply, "element face 32", "element face 30")).find("holds more than its header"),
            std::string::npos);
  const TemporaryFolder folder;
  const auto padded = read_surface(folder.write("a.stl", binary_stl("x", kTwoTriangles, 2) + "zzz"));
  ASSERT_TRUE(padded) << padded.error().message;
  EXPECT_NE(padded->notes.at(0).find("3 bytes behind its triangles are not read"), std::string::npos);
}

TEST(SurfaceFile, AnAsciiStlMayHaveCapitals) {
  std::string capitals = kStlText;
  for (char &c : capitals) {
    c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  }
  const auto upper = detail::parse_surface(capitals, "a.STL");
  const auto lower = detail::parse_surface(kStlText, "a.stl");
  ASSERT_TRUE(upper && lower);
  EXPECT_EQ(upper->mesh.vertices_mm, lower->mesh.vertices_mm);
}

// A cube of quads, of strips and of triangles has one area, in every format that has them.
TEST(SurfaceFile, PolygonsAndStripsAreSplitExactly) {
  const TemporaryFolder folder;
  const std::string points = "0 0 0\n90 0 0\n90 90 0\n0 90 0\n0 0 90\n90 0 90\n90 90 90\n0 90 90\n";
  const std::string quads = "4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string list = "property list int int vertex_indices\nend_header\n" + points;
  std::string obj = "# a cube\n";
  std::istringstream rows(points);
  for (std::string row; std::getline(rows, row);) {
    obj += "v " + row + "\n";
  }
  const std::string vtk = "# vtk DataFile Version 3.0\ncube\nASCII\nDATASET POLYDATA\nPOINTS 8 float\n" + points;
  const std::string round = "10 0 4 1 5 2 6 3 7 0 4"; // the four sides
  const std::string caps = "4 1 2 0 3\n4 4 5 7 6";
  for (const auto &[name, content] :
       {std::pair("quads.ply", ply + "element face 6\n" + list + quads),
        {"strips.ply", ply + "element tristrips 1\n" + list + "20 0 4 1 5 2 6 3 7 0 4 -1 1 2 0 3 -1 4 5 7 6"},
        {"quads.obj",
         obj + "f 1 4 3 2\nf 5/1 6/2 7/3 8/4\nf 1//1 2//1 6//1 5//1\nf -7 -6 -2 -3\nf 3 4 8 7\nf 4 1 5 8\n"},
        {"quads.vtk", vtk + "POLYGONS 6 30\n" + quads},
        {"strips.vtk", vtk + "TRIANGLE_STRIPS 3 21\n" + round + "\n" + caps + "\n"}}) {
    const auto read = read_surface(folder.write(name, content), {.space = Space::kRas});
    ASSERT_TRUE(read) << read.error().message;
    double area = 0.0;
    for (const auto &t : read->mesh.triangles) {
      const auto at = [&](int corner) { return read->mesh.vertices_mm[static_cast<std::size_t>(t[corner])]; };
      area += 0.5 * Vector3d((at(1) - at(0)).cross(at(2) - at(0))).norm();
    }
    EXPECT_EQ(read->mesh.triangles.size(), 12U) << name;
    EXPECT_NEAR(area, 6.0 * 90.0 * 90.0, 1e-6) << name;
    if (std::string(name).starts_with("quads")) {
      EXPECT_TRUE(check_closed(read->mesh)) << name << ": " << check_closed(read->mesh).error().message;
    }
  }
}

// Every format, cut at 200 places: refused, or nothing of the surface is missing, or the file cannot tell and it is
// said.
TEST(FaultInput, NoSurfaceThatWasCutIsReadInSilence) {
  const TemporaryFolder folder;
  const SurfaceReadOptions options{.size = kAnySize};
  int formats = 0;
  for (const auto &seed : std::filesystem::directory_iterator(BREGMA_SOURCE_DIR "/tests/fuzz/seeds/surfaces")) {
    const std::string name = seed.path().filename().string();
    const std::string bytes = bregma::tests::read_file(seed.path());
    const auto whole = read_surface(folder.write(name, bytes), options);
    ASSERT_TRUE(whole) << whole.error().message;
    ++formats;
    const std::size_t step = 1 + bytes.size() / 200;
    for (std::size_t size = 0; size < bytes.size(); size += step) {
      const auto cut = read_surface(folder.write("cut_" + name, bytes.substr(0, size)), options);
      if (!cut) {
        continue;
      }
      const bool same =
          cut->mesh.vertices_mm == whole->mesh.vertices_mm && cut->mesh.triangles == whole->mesh.triangles;
      const bool said = std::any_of(cut->notes.begin(), cut->notes.end(), [](const std::string &note) {
        return note.find("triangles were read") != std::string::npos ||
               note.find("geometry is not in the file") != std::string::npos;
      });
      EXPECT_TRUE(same || said) << name << ", " << size << " of " << bytes.size() << " bytes";
    }
  }
  EXPECT_GE(formats, 14);
}

TEST(SurfaceFile, ACloudIsReadOnlyWhereItIsWanted) {
  const TemporaryFolder folder;
  const auto file =
      folder.write("cloud.ply", "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                                "property float z\nend_header\n0 0 0\n90 0 0\n");
  EXPECT_FALSE(read_surface(file));
  const auto cloud = read_surface(file, {.points_only = true});
  ASSERT_TRUE(cloud) << cloud.error().message;
  EXPECT_EQ(cloud->mesh.vertices_mm.size(), 2U);
}

TEST(SurfaceFile, BigEndianPlyIsTheSameMesh) {
  const TemporaryFolder folder;
  std::string content =
      "ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty "
      "float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
  const auto put = [&content](auto value) {
    char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    content.append(std::reverse_iterator(bytes + sizeof value), std::reverse_iterator(bytes));
  };
  for (const float coordinate : {0.0F, 0.0F, 0.0F, 90.0F, 0.0F, 0.0F, 0.0F, 90.0F, 1.5F}) {
    put(coordinate);
  }
  content += '\x03';
  for (const std::int32_t corner : {0, 1, 2}) {
    put(corner);
  }
  const auto read = read_surface(folder.write("b.ply", content), {.space = Space::kRas});
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->mesh.vertices_mm[2], Vector3d(0.0, 90.0, 1.5));
  EXPECT_EQ(read->mesh.triangles[0], Eigen::Vector3i(0, 1, 2));
}

// A tetrahedron of a head's size in the GIFTI of FreeSurfer, or of another program.
std::string gifti_of(const std::string &before_points, const std::string &in_points) {
  return R"(<?xml version="1.0"?><GIFTI Version="1.0" NumberOfDataArrays="2">)" + before_points +
         R"(<DataArray Intent="NIFTI_INTENT_POINTSET" DataType="NIFTI_TYPE_FLOAT32" ArrayIndexingOrder="RowMajorOrder"
            Dimensionality="2" Dim0="4" Dim1="3" Encoding="ASCII">)" +
         in_points + R"(<Data>0 0 0 100 0 0 0 100 0 0 0 100</Data></DataArray>
         <DataArray Intent="NIFTI_INTENT_TRIANGLE" DataType="NIFTI_TYPE_INT32" ArrayIndexingOrder="RowMajorOrder"
            Dimensionality="2" Dim0="4" Dim1="3" Encoding="ASCII"><Data>0 2 1 0 1 3 0 3 2 1 2 3</Data></DataArray></GIFTI>)";
}

std::string volume_geometry() {
  std::string out = "<MetaData>";
  const std::pair<const char *, double> values[] = {{"X_R", -1}, {"X_A", 0},   {"X_S", 0},  {"Y_R", 0},
                                                    {"Y_A", 0},  {"Y_S", -1},  {"Z_R", 0},  {"Z_A", 1},
                                                    {"Z_S", 0},  {"C_R", 5.4}, {"C_A", 18}, {"C_S", -21}};
  for (const auto &[name, value] : values) {
    out += "<MD><Name><![CDATA[VolGeom" + std::string(name) + "]]></Name><Value><![CDATA[" + std::to_string(value) +
           "]]></Value></MD>";
  }
  return out + "</MetaData>";
}

std::string coordinates(const std::string &from, const std::string &to, const std::string &matrix) {
  return "<CoordinateSystemTransformMatrix><DataSpace><![CDATA[" + from + "]]></DataSpace><TransformedSpace><![CDATA[" +
         to + "]]></TransformedSpace><MatrixData>" + matrix + "</MatrixData></CoordinateSystemTransformMatrix>";
}

TEST(SurfaceFile, WhatAGiftiStatesAboutItsFrameIsApplied) {
  const TemporaryFolder folder;
  const std::string moved = "1 0 0 5.4 0 1 0 18 0 0 1 -21 0 0 0 1";
  const std::string identity = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
  const Vector3d c_ras(5.4, 18.0, -21.0);
  const std::string unknown = "NIFTI_XFORM_UNKNOWN";
  const std::string scanner = "NIFTI_XFORM_SCANNER_ANAT";
  for (const auto &[what, first] :
       {std::pair(std::string(), Vector3d(Vector3d::Zero())),
        {volume_geometry(), c_ras},
        {volume_geometry() + coordinates(unknown, "NIFTI_XFORM_TALAIRACH", identity), c_ras},
        {volume_geometry() + coordinates(unknown, scanner, moved), c_ras},
        {coordinates(unknown, scanner, moved), c_ras},
        {volume_geometry() + coordinates(scanner, scanner, identity), Vector3d(Vector3d::Zero())},
        {coordinates(scanner, "NIFTI_XFORM_MNI_152", moved), Vector3d(Vector3d::Zero())}}) {
    const auto read = read_surface(folder.write("s.surf.gii", gifti_of("", what)));
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_TRUE((read->mesh.vertices_mm[0] - first).isZero(1e-4)) << what << read->mesh.vertices_mm[0];
    EXPECT_TRUE((read->mesh.vertices_mm[3] - first - Vector3d(0, 0, 100)).isZero(1e-4)) << what;
    EXPECT_EQ(read->notes.empty(), first.isZero()) << what;
    EXPECT_EQ(read->space_stated, !what.empty()) << what;
    const auto said_lps = read_surface(folder.path() / "s.surf.gii", {.space = Space::kLps});
    ASSERT_TRUE(said_lps) << said_lps.error().message;
    EXPECT_EQ(said_lps->mesh.vertices_mm[0].isApprox(read->mesh.vertices_mm[0]), !what.empty() || first.isZero());
  }
}

// Two public heads.
TEST(SurfaceFile, ColinsSkinIsReadWithoutConversion) {
  BREGMA_SHARED_DATA(file, "meshes/colin27/colin27_outer_skin_surface.asc");
  const auto read = read_surface(file);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->mesh.vertices_mm.size(), 10242U);
  EXPECT_EQ(read->mesh.triangles.size(), 20480U);
  EXPECT_EQ(read->mesh.vertices_mm[1], Vector3d(25.069870, -83.267921, 32.866287));
  EXPECT_TRUE(check_closed(read->mesh)) << check_closed(read->mesh).error().message;
}

TEST(SurfaceFile, TheMniScalpIsReadFromGifti) {
  BREGMA_SHARED_DATA(file, "images/mni/scalp_2562.surf.gii");
  const auto read = read_surface(file);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->format, "GIFTI");
  EXPECT_EQ(read->mesh.vertices_mm.size(), 2562U);
  EXPECT_EQ(read->mesh.triangles.size(), 5120U);
  EXPECT_TRUE(check_closed(read->mesh)) << check_closed(read->mesh).error().message;
  // In MNI space the origin is the anterior commissure, with the crown above it and the nose in front.
  Eigen::AlignedBox3d box;
  for (const Vector3d &v : read->mesh.vertices_mm) {
    box.extend(v);
  }
  EXPECT_NEAR(box.center().x(), 0.0, 5.0);
  EXPECT_GT(box.max().z(), 90.0);
  EXPECT_LT(box.max().z(), 120.0);
}

} // namespace
