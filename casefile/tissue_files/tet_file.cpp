#include "casefile/tissue_files/tet_file.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>

#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDoubleArray.h>
#include <vtkFieldData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkStringArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridWriter.h>

#include "base/write_file.hpp"
namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

constexpr std::array<const char *, 6> kTensorNames{"XX", "YY", "ZZ", "XY", "YZ", "XZ"}; // as ParaView shows them

// The reason why the fields are invalid; empty if they are valid.
std::string fields_problem(std::span<const TetField> fields, std::size_t rows, const char *of) {
  for (auto field = fields.begin(); field != fields.end(); ++field) {
    const std::string which = "field \"" + field->name + "\" of the " + of + " ";
    if (field->name.empty()) {
      return std::string("a field of the ") + of + " has no name";
    }
    if (std::any_of(fields.begin(), field, [&](const TetField &other) { return other.name == field->name; })) {
      return which + "is there twice";
    }
    if (field->components != 1 && field->components != 3 && field->components != 6) {
      return which + "has " + std::to_string(field->components) + " components; must be 1, 3 or 6";
    }
    if (const std::size_t wanted = rows * static_cast<std::size_t>(field->components); field->values.size() != wanted) {
      return which + "has " + std::to_string(field->values.size()) + " values, must have " + std::to_string(wanted);
    }
  }
  return {};
}

std::string problem_of(const tissue::TetMesh &mesh, std::span<const TetField> node_fields,
                       std::span<const TetField> cell_fields) {
  try {
    tissue::check(mesh);
  } catch (const std::invalid_argument &error) {
    return error.what();
  }
  const std::string problem = fields_problem(node_fields, mesh.nodes_mm.size(), "nodes");
  return problem.empty() ? fields_problem(cell_fields, mesh.tetrahedra.size(), "tetrahedra") : problem;
}

void add_fields(std::span<const TetField> fields, vtkFieldData *to) {
  for (const TetField &field : fields) {
    vtkNew<vtkDoubleArray> array;
    array->SetName(field.name.c_str());
    array->SetNumberOfComponents(field.components);
    for (int i = 0; field.components == 6 && i < 6; ++i) {
      array->SetComponentName(i, kTensorNames[static_cast<std::size_t>(i)]);
    }
    array->SetNumberOfTuples(static_cast<vtkIdType>(field.values.size()) / field.components);
    std::copy(field.values.begin(), field.values.end(), array->GetPointer(0));
    to->AddArray(array);
  }
}

vtkSmartPointer<vtkUnstructuredGrid> to_grid(const tissue::TetMesh &mesh) {
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  points->SetNumberOfPoints(static_cast<vtkIdType>(mesh.nodes_mm.size()));
  for (std::size_t i = 0; i < mesh.nodes_mm.size(); ++i) {
    points->SetPoint(static_cast<vtkIdType>(i), mesh.nodes_mm[i].data());
  }
  vtkNew<vtkCellArray> cells;
  for (const Eigen::Vector4i &t : mesh.tetrahedra) {
    cells->InsertNextCell({t[0], t[1], t[2], t[3]});
  }
  auto grid = vtkSmartPointer<vtkUnstructuredGrid>::New();
  grid->SetPoints(points);
  grid->SetCells(VTK_TETRA, cells);
  vtkNew<vtkStringArray> space;
  space->SetName("SPACE");
  space->InsertNextValue("RAS");
  grid->GetFieldData()->AddArray(space);
  return grid;
}

// Writes to memory first: VTK prints the error of a full disk instead of returning it.
std::string to_text(vtkUnstructuredGrid *grid) {
  vtkNew<vtkXMLUnstructuredGridWriter> writer;
  writer->SetInputData(grid);
  writer->SetDataModeToAppended();
  writer->EncodeAppendedDataOff();
  writer->WriteToOutputStringOn();
  return writer->Write() == 1 ? writer->GetOutputString() : std::string();
}

} // namespace

base::Result<void> write_tet_mesh(const fs::path &file, const tissue::TetMesh &mesh,
                                  std::span<const TetField> node_fields, std::span<const TetField> cell_fields) {
  if (const std::string problem = problem_of(mesh, node_fields, cell_fields); !problem.empty()) {
    return base::failure(file.string() + ": is not written: " + problem);
  }
  const auto grid = to_grid(mesh);
  add_fields(node_fields, grid->GetPointData());
  add_fields(cell_fields, grid->GetCellData());
  const std::string text = to_text(grid);
  if (text.empty()) {
    return base::failure(file.string() + ": VTK cannot write this mesh");
  }
  return base::write_file(file, text);
}

} // namespace bregma::casefile
