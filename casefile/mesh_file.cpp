#include "casefile/mesh_file.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <sstream>
#include <string>
#include <system_error>
#include <unordered_map>

#include <Eigen/Geometry>
#include <vtkCellArray.h>
#include <vtkCommand.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkObject.h>
#include <vtkPLYReader.h>
#include <vtkPLYWriter.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>

namespace bregma::casefile {

namespace {

using geometry::TriangleMesh;

// VTK reports errors as events; unobserved they are printed and lost.
class ErrorListener : public vtkCommand {
public:
  static ErrorListener *New() { return new ErrorListener; } // NOLINT(readability-identifier-naming): VTK's protocol
  void Execute(vtkObject *, unsigned long, void *text) override {
    if (text != nullptr && message_.empty()) {
      message_ = static_cast<const char *>(text);
      message_.erase(std::remove(message_.begin(), message_.end(), '\n'), message_.end());
    }
  }
  [[nodiscard]] bool heard() const { return !message_.empty(); }
  [[nodiscard]] const std::string &message() const { return message_; }

private:
  std::string message_;
};

// How many of each the header promises; VTK returns what it could read without a word about the rest.
struct PlyCounts {
  vtkIdType vertices = 0;
  vtkIdType faces = 0;
};

Result<PlyCounts> read_header(const std::filesystem::path &file) {
  std::error_code error;
  std::ifstream in(file, std::ios::binary);
  if (!in || std::filesystem::is_directory(file, error)) {
    return failure(file.string() + ": no such file, or it cannot be read");
  }
  std::string line;
  std::getline(in, line);
  if (!line.starts_with("ply")) {
    return failure(file.string() + ": is not a PLY file");
  }
  PlyCounts counts;
  while (std::getline(in, line) && !line.starts_with("end_header")) {
    std::istringstream words(line);
    std::string element;
    std::string name;
    vtkIdType count = 0;
    if (words >> element >> name >> count && element == "element") {
      (name == "vertex" ? counts.vertices : counts.faces) = count;
    }
  }
  if (!in) {
    return failure(file.string() + ": the PLY header has no end");
  }
  if (counts.vertices <= 0 || counts.faces <= 0) {
    return failure(file.string() + ": holds no surface");
  }
  return counts;
}

std::string mesh_problem(const TriangleMesh &mesh) {
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    if (!mesh.vertices_mm[i].allFinite()) {
      return "vertex " + std::to_string(i) + " is not finite";
    }
  }
  const auto count = static_cast<int>(mesh.vertices_mm.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Eigen::Vector3i &t = mesh.triangles[i];
    if (t.minCoeff() < 0 || t.maxCoeff() >= count) {
      return "triangle " + std::to_string(i) + " refers to a vertex that does not exist";
    }
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
      return "triangle " + std::to_string(i) + " has a vertex twice";
    }
  }
  return {};
}

double volume_mm3(const TriangleMesh &mesh) {
  double six_volumes = 0.0;
  for (const Eigen::Vector3i &t : mesh.triangles) {
    const auto &v = mesh.vertices_mm;
    const auto at = [&](int corner) { return v[static_cast<std::size_t>(t[corner])] - v.front(); };
    const Eigen::Vector3d a = at(0);
    const Eigen::Vector3d b = at(1);
    const Eigen::Vector3d c = at(2);
    six_volumes += a.dot(b.cross(c));
  }
  return six_volumes / 6.0;
}

} // namespace

Result<TriangleMesh> read_mesh(const std::filesystem::path &file) {
  const auto counts = read_header(file);
  if (!counts) {
    return tl::unexpected(counts.error());
  }
  vtkNew<ErrorListener> errors;
  vtkNew<vtkPLYReader> reader;
  reader->AddObserver(vtkCommand::ErrorEvent, errors);
  reader->SetFileName(file.c_str());
  reader->Update();
  vtkPolyData *surface = reader->GetOutput();
  if (errors->heard()) {
    return failure(file.string() + ": " + errors->message());
  }
  if (surface->GetNumberOfPoints() != counts->vertices || surface->GetNumberOfPolys() != counts->faces) {
    return failure(file.string() + ": " + std::to_string(surface->GetNumberOfPolys()) + " of " +
                   std::to_string(counts->faces) + " triangles could be read: the file is damaged");
  }
  TriangleMesh mesh;
  mesh.vertices_mm.resize(static_cast<std::size_t>(counts->vertices));
  for (vtkIdType i = 0; i < counts->vertices; ++i) {
    surface->GetPoint(i, mesh.vertices_mm[static_cast<std::size_t>(i)].data());
  }
  vtkNew<vtkIdList> corners;
  vtkCellArray *faces = surface->GetPolys();
  for (vtkIdType i = 0; i < counts->faces; ++i) {
    faces->GetCellAtId(i, corners);
    if (corners->GetNumberOfIds() != 3) {
      return failure(file.string() + ": face " + std::to_string(i) + " has " +
                     std::to_string(corners->GetNumberOfIds()) + " corners, only triangles are read");
    }
    mesh.triangles.emplace_back(static_cast<int>(corners->GetId(0)), static_cast<int>(corners->GetId(1)),
                                static_cast<int>(corners->GetId(2)));
  }
  if (const std::string problem = mesh_problem(mesh); !problem.empty()) {
    return failure(file.string() + ": " + problem);
  }
  return mesh;
}

Result<void> write_mesh(const std::filesystem::path &file, const TriangleMesh &mesh) {
  if (const std::string problem = mesh_problem(mesh); !problem.empty()) {
    return failure(file.string() + ": not written: " + problem);
  }
  vtkNew<vtkPoints> points;
  points->SetDataTypeToFloat();
  points->SetNumberOfPoints(static_cast<vtkIdType>(mesh.vertices_mm.size()));
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    points->SetPoint(static_cast<vtkIdType>(i), mesh.vertices_mm[i].data());
  }
  vtkNew<vtkCellArray> faces;
  for (const Eigen::Vector3i &t : mesh.triangles) {
    const std::array<vtkIdType, 3> corners{t[0], t[1], t[2]};
    faces->InsertNextCell(3, corners.data());
  }
  vtkNew<vtkPolyData> surface;
  surface->SetPoints(points);
  surface->SetPolys(faces);
  vtkNew<ErrorListener> errors;
  vtkNew<vtkPLYWriter> writer;
  writer->AddObserver(vtkCommand::ErrorEvent, errors);
  writer->SetFileName(file.c_str());
  writer->SetFileTypeToBinary();
  writer->SetDataByteOrderToLittleEndian();
  writer->SetInputData(surface);
  if (writer->Write() == 0 || errors->heard()) {
    return failure(file.string() + ": cannot be written" + (errors->heard() ? ": " + errors->message() : ""));
  }
  return {};
}

Result<void> check_closed(const TriangleMesh &mesh) {
  if (mesh.triangles.empty()) {
    return failure("the surface is empty");
  }
  if (const std::string problem = mesh_problem(mesh); !problem.empty()) {
    return failure(problem);
  }
  // Of every directed edge there is one, and one in the other direction.
  const auto key = [](int from, int to) {
    return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(from)) << 32U) | static_cast<std::uint32_t>(to);
  };
  std::unordered_map<std::uint64_t, int> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const Eigen::Vector3i &t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) {
      if (++edges[key(t[i], t[(i + 1) % 3])] > 1) {
        return failure("the surface is not oriented: two triangles run along the edge of vertices " +
                       std::to_string(t[i]) + " and " + std::to_string(t[(i + 1) % 3]) + " in the same direction");
      }
    }
  }
  std::size_t open = 0;
  for (const auto &[edge, count] : edges) {
    const std::uint64_t back = (edge << 32U) | (edge >> 32U);
    open += edges.contains(back) ? 0 : 1;
  }
  if (open > 0) {
    return failure("the surface is not closed: " + std::to_string(open) + " edges belong to one triangle only");
  }
  if (const double volume = volume_mm3(mesh); !(volume > 0.0)) {
    return failure("the surface is inside out: its triangles face inwards");
  }
  return {};
}

} // namespace bregma::casefile
