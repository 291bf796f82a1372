// The readers compared with VTK's writers, in every encoding of VTK.
#include <algorithm>

#include <gtest/gtest.h>

#include <vtkCellArray.h>
#include <vtkFieldData.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataWriter.h>
#include <vtkSTLWriter.h>
#include <vtkStringArray.h>
#include <vtkXMLPolyDataWriter.h>

#include "casefile/surface_files/surface_file.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace {

using bregma::casefile::read_surface;
using bregma::casefile::Space;
using bregma::surface::TriangleMesh;
using bregma::test::TemporaryFolder;

vtkSmartPointer<vtkPolyData> to_vtk(const TriangleMesh &mesh, int precision) {
  vtkNew<vtkPoints> points;
  points->SetDataType(precision);
  for (const Eigen::Vector3d &v : mesh.vertices_mm) {
    points->InsertNextPoint(v.data());
  }
  vtkNew<vtkCellArray> cells;
  for (const Eigen::Vector3i &t : mesh.triangles) {
    cells->InsertNextCell({t[0], t[1], t[2]});
  }
  auto out = vtkSmartPointer<vtkPolyData>::New();
  out->SetPoints(points);
  out->SetPolys(cells);
  return out;
}

void expect_lps_of(const TriangleMesh &lps, const std::filesystem::path &file, double tolerance_mm, bool stated) {
  const auto read = read_surface(file);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->space_stated, stated) << file;
  EXPECT_EQ(read->space, Space::kLps);
  ASSERT_EQ(read->mesh.vertices_mm.size(), lps.vertices_mm.size()) << file;
  ASSERT_EQ(read->mesh.triangles, lps.triangles) << file;
  for (std::size_t i = 0; i < lps.vertices_mm.size(); ++i) {
    ASSERT_LT((read->mesh.vertices_mm[i] - bregma::casefile::flipped(lps.vertices_mm[i])).norm(), tolerance_mm) << file;
  }
}

const TriangleMesh kHead = bregma::tests::sphere({12, -34, 56}, 85, 4);

TEST(SurfaceOfVtk, LegacyFilesOfEveryVersionAndEncoding) {
  const TemporaryFolder folder;
  for (const int precision : {VTK_FLOAT, VTK_DOUBLE}) {
    for (const int version : {42, 51}) {
      for (const int encoding : {VTK_ASCII, VTK_BINARY}) {
        const auto file = folder.path() / ("a" + std::to_string(version) + std::to_string(encoding) + ".vtk");
        vtkNew<vtkPolyDataWriter> writer;
        writer->SetInputData(to_vtk(kHead, precision));
        writer->SetFileName(file.c_str());
        writer->SetFileVersion(version);
        writer->SetFileType(encoding);
        writer->SetHeader("3D Slicer output. SPACE=LPS");
        ASSERT_EQ(writer->Write(), 1);
        expect_lps_of(kHead, file, encoding == VTK_ASCII ? 1e-3 : 1e-4, true);
      }
    }
  }
}

TEST(SurfaceOfVtk, XmlFilesOfEveryEncoding) {
  const TemporaryFolder folder;
  const auto data = to_vtk(kHead, VTK_FLOAT);
  for (const bool stated : {false, true}) {
    if (stated) { // as in Slicer
      vtkNew<vtkStringArray> space;
      space->SetName("SPACE");
      space->InsertNextValue("LPS");
      data->GetFieldData()->AddArray(space);
    }
    for (const int mode : {vtkXMLWriter::Ascii, vtkXMLWriter::Binary, vtkXMLWriter::Appended}) {
      for (const int compressor : {vtkXMLWriter::NONE, vtkXMLWriter::ZLIB}) {
        for (const bool base64 : {true, false}) {
          for (const int header : {vtkXMLWriter::UInt32, vtkXMLWriter::UInt64}) {
            const auto file = folder.path() / "a.vtp";
            vtkNew<vtkXMLPolyDataWriter> writer;
            writer->SetInputData(data);
            writer->SetFileName(file.c_str());
            writer->SetDataMode(mode);
            writer->SetCompressorType(compressor);
            writer->SetEncodeAppendedData(base64);
            writer->SetHeaderType(header);
            writer->SetBlockSize(4096); // several blocks per array
            ASSERT_EQ(writer->Write(), 1);
            SCOPED_TRACE("mode " + std::to_string(mode) + ", compressor " + std::to_string(compressor) + ", base64 " +
                         std::to_string(base64) + ", header " + std::to_string(header));
            expect_lps_of(kHead, file, 1e-3, stated);
          }
        }
      }
    }
  }
}

TEST(SurfaceOfVtk, StlOfBothEncodings) {
  const TemporaryFolder folder;
  for (const int encoding : {VTK_ASCII, VTK_BINARY}) {
    const auto file = folder.path() / "a.stl";
    vtkNew<vtkSTLWriter> writer;
    writer->SetInputData(to_vtk(kHead, VTK_FLOAT));
    writer->SetFileName(file.c_str());
    writer->SetFileType(encoding);
    writer->SetHeader("3D Slicer output. SPACE=LPS");
    ASSERT_EQ(writer->Write(), 1);
    const auto read = read_surface(file);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_TRUE(read->space_stated);
    EXPECT_EQ(read->mesh.triangles.size(), kHead.triangles.size());
    EXPECT_EQ(read->mesh.vertices_mm.size(), kHead.vertices_mm.size()) << "corners at one place are one vertex";
  }
}

TEST(SurfaceOfVtk, DamagedXmlIsRefusedWithItsLine) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "a.vtp";
  vtkNew<vtkXMLPolyDataWriter> writer;
  writer->SetInputData(to_vtk(bregma::tests::sphere({0, 0, 0}, 85, 0), VTK_FLOAT));
  writer->SetFileName(file.c_str());
  writer->SetDataModeToAscii();
  ASSERT_EQ(writer->Write(), 1);
  const std::string whole = bregma::tests::read_file(file);
  const auto error_of = [&](const std::string &from, const std::string &to) {
    std::string content = whole;
    const std::size_t at = content.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    content.replace(at, from.size(), to);
    const auto read = read_surface(folder.write("b.vtp", content));
    const std::string message = read ? "no error" : read.error().message;
    return message.substr(std::min(message.size(), message.find("b.vtp")));
  };
  // Counted from 1.
  const auto line_of = [&whole](std::size_t position) {
    const auto end = whole.begin() + static_cast<std::ptrdiff_t>(position);
    return std::to_string(1 + std::count(whole.begin(), end, '\n'));
  };
  EXPECT_EQ(error_of("</PolyData>", "</PolyDat>"),
            "b.vtp:" + line_of(whole.find("</PolyData>")) + ": is not whole XML: mismatched tag");
  EXPECT_EQ(error_of("NumberOfPolys=\"8\"", "NumberOfPolys=\"0\""),
            "b.vtp: the mesh is empty: it has 6 vertices and no triangle");
  EXPECT_EQ(error_of("85 0 0", "85 nan 0"),
            "b.vtp:" + line_of(whole.find("85 0 0")) + ": the points: number 1 = \"nan\": must be a finite number");
  EXPECT_EQ(error_of("0 2 4", "0 2 9"),
            "b.vtp:" + line_of(whole.rfind("connectivity")) + ": triangle 0: corner = 9: must be a vertex, 0 to 5");
  EXPECT_NE(error_of("NumberOfPolys=\"8\"", "NumberOfPolys=\"9\"").find(": the file ends before offsets: number 8"),
            std::string::npos);
  EXPECT_NE(error_of("NumberOfPoints=\"6\"", "NumberOfPoints=\"5\"").find(": the points has more than 15 numbers"),
            std::string::npos);
  EXPECT_EQ(error_of("<?xml version=\"1.0\"?>", "<?xml version=\"1.0\"?><!DOCTYPE a [<!ENTITY b \"c\">]>"),
            "b.vtp:1: the file declares an entity (b), which is not read");
}

} // namespace
