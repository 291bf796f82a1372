// Written files are read by VTK, as in ParaView and Slicer.
#include <gtest/gtest.h>

#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDataArray.h>
#include <vtkFieldData.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkStringArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>

#include "casefile/tissue_files/tet_file.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using bregma::casefile::TetField;
using bregma::casefile::write_tet_mesh;
using bregma::test::TemporaryFolder;
using bregma::tissue::TetMesh;

const TetMesh kBlock = bregma::tissue::block_mesh({2, 3, 4}, {20.0, 30.0, 41.5});

std::vector<double> ascending(std::size_t count, double first) {
  std::vector<double> out;
  for (std::size_t i = 0; i < count; ++i) {
    out.push_back(first + 0.125 * static_cast<double>(i));
  }
  return out;
}

void expect_field(vtkDataArray *array, const TetField &field) {
  ASSERT_NE(array, nullptr) << field.name;
  ASSERT_EQ(array->GetNumberOfComponents(), field.components);
  ASSERT_EQ(static_cast<std::size_t>(array->GetNumberOfValues()), field.values.size());
  for (std::size_t i = 0; i < field.values.size(); ++i) {
    const auto row = static_cast<vtkIdType>(i) / field.components;
    const int component = static_cast<int>(i) % field.components;
    ASSERT_EQ(array->GetComponent(row, component), field.values[i]) << field.name << " " << i;
  }
}

TEST(TetFile, VtkReadsTheMeshAndItsFields) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "tissue.vtu";
  const std::vector<TetField> nodes{{"displacement_mm", 3, ascending(3 * kBlock.nodes_mm.size(), -7.0)}};
  const std::vector<TetField> cells{{"von_mises_Pa", 1, ascending(kBlock.tetrahedra.size(), 0.0)},
                                    {"cauchy_Pa", 6, ascending(6 * kBlock.tetrahedra.size(), 1e6)}};
  const auto written = write_tet_mesh(file, kBlock, nodes, cells);
  ASSERT_TRUE(written) << written.error().message;

  vtkNew<vtkXMLUnstructuredGridReader> reader;
  ASSERT_EQ(reader->CanReadFile(file.c_str()), 1);
  reader->SetFileName(file.c_str());
  reader->Update();
  vtkUnstructuredGrid *grid = reader->GetOutput();
  ASSERT_EQ(static_cast<std::size_t>(grid->GetNumberOfPoints()), kBlock.nodes_mm.size());
  ASSERT_EQ(static_cast<std::size_t>(grid->GetNumberOfCells()), kBlock.tetrahedra.size());
  for (std::size_t i = 0; i < kBlock.nodes_mm.size(); ++i) {
    EXPECT_EQ(Eigen::Vector3d(grid->GetPoint(static_cast<vtkIdType>(i))), kBlock.nodes_mm[i]);
  }
  vtkNew<vtkIdList> corners;
  for (std::size_t i = 0; i < kBlock.tetrahedra.size(); ++i) {
    const auto cell = static_cast<vtkIdType>(i);
    ASSERT_EQ(grid->GetCellType(cell), VTK_TETRA);
    grid->GetCellPoints(cell, corners);
    for (int k = 0; k < 4; ++k) {
      ASSERT_EQ(corners->GetId(k), kBlock.tetrahedra[i][k]);
    }
  }
  expect_field(grid->GetPointData()->GetArray("displacement_mm"), nodes[0]);
  expect_field(grid->GetCellData()->GetArray("von_mises_Pa"), cells[0]);
  expect_field(grid->GetCellData()->GetArray("cauchy_Pa"), cells[1]);
  EXPECT_STREQ(grid->GetCellData()->GetArray("cauchy_Pa")->GetComponentName(3), "XY");
  auto *space = vtkStringArray::SafeDownCast(grid->GetFieldData()->GetAbstractArray("SPACE"));
  ASSERT_NE(space, nullptr) << "Slicer would take the points for LPS";
  EXPECT_EQ(space->GetValue(0), "RAS");
}

TEST(TetFile, WhatIsWrongIsSaidWithTheFile) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "t.vtu";
  const auto error_of = [&](const TetMesh &mesh, const std::vector<TetField> &nodes,
                            const std::vector<TetField> &cells) {
    const auto written = write_tet_mesh(file, mesh, nodes, cells);
    EXPECT_FALSE(std::filesystem::exists(file));
    return written ? "no error" : written.error().message.substr(file.string().size());
  };
  EXPECT_EQ(error_of(kBlock, {{"u_mm", 3, {1.0, 2.0}}}, {}),
            ": is not written: field \"u_mm\" of the nodes has 2 values, must have 180");
  EXPECT_EQ(error_of(kBlock, {}, {{"s", 2, {}}}),
            ": is not written: field \"s\" of the tetrahedra has 2 components; must be 1, 3 or 6");
  const TetField one{"s", 1, ascending(144, 0.0)};
  EXPECT_EQ(error_of(kBlock, {}, {one, one}), ": is not written: field \"s\" of the tetrahedra is there twice");
  EXPECT_EQ(error_of(kBlock, {{"", 1, {}}}, {}), ": is not written: a field of the nodes has no name");
  TetMesh turned = kBlock;
  std::swap(turned.tetrahedra[5][0], turned.tetrahedra[5][1]);
  EXPECT_NE(error_of(turned, {}, {}).find(": is not written: tetrahedron 5"), std::string::npos)
      << error_of(turned, {}, {});
}

TEST(TetFile, AFolderThatIsNotThereIsNamedAndAnOldFileStays) {
  const TemporaryFolder folder;
  const auto nowhere = folder.path() / "none" / "t.vtu";
  const auto written = write_tet_mesh(nowhere, kBlock);
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().message, nowhere.string() + ": cannot be written: No such file or directory");

  const auto old = folder.write("old.vtu", "old");
  EXPECT_FALSE(write_tet_mesh(old, TetMesh{}));
  EXPECT_EQ(bregma::tests::read_file(old), "old");
  ASSERT_TRUE(write_tet_mesh(old, kBlock));
  EXPECT_NE(bregma::tests::read_file(old), "old");
  EXPECT_FALSE(std::filesystem::exists(old.string() + ".new"));
}

} // namespace
