// PLY surfaces compared with VTK's reader and writer.
#include <gtest/gtest.h>

#include <vtkCellArray.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPLYReader.h>
#include <vtkPLYWriter.h>
#include <vtkPolyData.h>

#include "casefile/mesh_file.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace {

using bregma::surface::TriangleMesh;

void expect_same(vtkPolyData *surface, const TriangleMesh &mesh) {
  ASSERT_EQ(surface->GetNumberOfPoints(), static_cast<vtkIdType>(mesh.vertices_mm.size()));
  ASSERT_EQ(surface->GetNumberOfPolys(), static_cast<vtkIdType>(mesh.triangles.size()));
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    const Eigen::Map<const Eigen::Vector3d> point(surface->GetPoint(static_cast<vtkIdType>(i)));
    ASSERT_LT((point - mesh.vertices_mm[i]).norm(), 1e-5) << i;
  }
  vtkNew<vtkIdList> corners;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    surface->GetPolys()->GetCellAtId(static_cast<vtkIdType>(i), corners);
    for (int k = 0; k < 3; ++k) {
      ASSERT_EQ(corners->GetId(k), mesh.triangles[i][k]) << i;
    }
  }
}

TEST(Ply, VtkReadsWhatIsWrittenAndIsReadItself) {
  const bregma::test::TemporaryFolder folder;
  const TriangleMesh mesh = bregma::tests::sphere({10, -20, 30}, 80);
  const auto ours = folder.path() / "ours.ply";
  ASSERT_TRUE(bregma::casefile::write_mesh(ours, mesh));
  vtkNew<vtkPLYReader> reader;
  reader->SetFileName(ours.c_str());
  reader->Update();
  expect_same(reader->GetOutput(), mesh);

  for (const bool binary : {true, false}) {
    const auto theirs = folder.path() / "theirs.ply";
    vtkNew<vtkPLYWriter> writer;
    writer->SetFileName(theirs.c_str());
    writer->SetFileType(binary ? VTK_BINARY : VTK_ASCII);
    writer->SetDataByteOrderToLittleEndian();
    writer->SetInputData(reader->GetOutput());
    ASSERT_EQ(writer->Write(), 1);
    const auto read = bregma::casefile::read_mesh(theirs);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->triangles, mesh.triangles);
    for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
      EXPECT_LT((read->vertices_mm[i] - mesh.vertices_mm[i]).norm(), 1e-3) << "ASCII keeps six digits";
    }
  }
}

} // namespace
