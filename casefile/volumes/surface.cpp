#include "casefile/volumes/surface.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>

#include <Eigen/LU>
#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkIdList.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkQuadricDecimation.h>
#include <vtkSmartPointer.h>
#include <vtkStaticCellLocator.h>
#include <vtkWindowedSincPolyDataFilter.h>

#include "casefile/volumes/decimation.hpp"
#include "casefile/volumes/segmentation.hpp"

namespace bregma::casefile {
namespace {

using surface::TriangleMesh;

// Leaves the filters' call stack when the user cancels.
struct Stopped : std::exception {};

// Of the image of a head, along its longest axis.
constexpr double kLeastExtent_mm = 30.0; // a head of 260 mm in cm has 26
constexpr double kLargestExtent_mm = 3000.0;

// Fraction of the time that segmentation takes.
constexpr double kSegmentationShare = 0.6;

Step step_within(const Progress &progress, double from, double to) {
  return [&progress, from, to](double done, std::string_view stage) {
    if (progress && !progress(from + (to - from) * done, stage)) {
      throw Stopped();
    }
  };
}

// In the axes of the grid, mm: index times spacing.
vtkSmartPointer<vtkPolyData> isosurface(const Volume &grid) {
  vtkNew<vtkFloatArray> values;
  // Read only: VTK has no const arrays.
  values->SetArray(const_cast<float *>(grid.voxels.data()), static_cast<vtkIdType>(grid.voxels.size()), 1); // NOLINT
  vtkNew<vtkImageData> image;
  image->SetDimensions(grid.size[0], grid.size[1], grid.size[2]);
  image->SetSpacing(grid.spacing_mm().data());
  image->GetPointData()->SetScalars(values);
  vtkNew<vtkFlyingEdges3D> edges;
  edges->SetInputData(image);
  // Not exactly 0.5: a blurred mask reaches that value exactly at some voxels, where triangles would collapse.
  edges->SetValue(0, 0.500013);
  edges->ComputeNormalsOff();
  edges->ComputeGradientsOff();
  edges->ComputeScalarsOff();
  edges->Update();
  return edges->GetOutput();
}

vtkSmartPointer<vtkPolyData> smoothed(vtkPolyData *mesh, const SurfaceOptions &options) {
  if (options.smoothing_iterations < 1) {
    return mesh;
  }
  vtkNew<vtkWindowedSincPolyDataFilter> sinc;
  sinc->SetInputData(mesh);
  sinc->SetNumberOfIterations(options.smoothing_iterations);
  sinc->SetPassBand(options.pass_band);
  sinc->BoundarySmoothingOff();
  sinc->FeatureEdgeSmoothingOff();
  sinc->NonManifoldSmoothingOn();
  sinc->NormalizeCoordinatesOn();
  sinc->Update();
  return sinc->GetOutput();
}

// Better shaped triangles than those of decimated(), but it can pinch the surface.
vtkSmartPointer<vtkPolyData> quadric_decimated(vtkPolyData *mesh, int vertices) {
  // On a closed surface a collapse takes one vertex and two triangles.
  const double excess = static_cast<double>(mesh->GetNumberOfPoints() - vertices);
  vtkNew<vtkQuadricDecimation> filter;
  filter->SetInputData(mesh);
  filter->SetTargetReduction(2.0 * excess / static_cast<double>(mesh->GetNumberOfCells()));
  filter->Update();
  return filter->GetOutput();
}

TriangleMesh mesh_in_image(vtkPolyData *data, const Volume &grid) {
  const Eigen::Matrix3d A = grid.T_image_index.topLeftCorner<3, 3>() * grid.spacing_mm().cwiseInverse().asDiagonal();
  const Eigen::Vector3d origin = grid.T_image_index.topRightCorner<3, 1>();
  TriangleMesh mesh;
  std::vector<int> new_index(static_cast<std::size_t>(data->GetNumberOfPoints()), -1);
  vtkNew<vtkIdList> corners;
  for (vtkIdType cell = 0; cell < data->GetNumberOfCells(); ++cell) {
    data->GetCellPoints(cell, corners);
    Eigen::Vector3i triangle;
    for (int corner = 0; corner < 3; ++corner) {
      int &index = new_index[static_cast<std::size_t>(corners->GetId(corner))];
      if (index < 0) { // skips points that no triangle uses
        index = static_cast<int>(mesh.vertices_mm.size());
        mesh.vertices_mm.emplace_back(A * Eigen::Vector3d(data->GetPoint(corners->GetId(corner))) + origin);
      }
      triangle[corner] = index;
    }
    mesh.triangles.push_back(triangle);
  }
  if (check_mesh(mesh).volume_ml < 0.0) {
    for (Eigen::Vector3i &triangle : mesh.triangles) {
      std::swap(triangle[1], triangle[2]);
    }
  }
  return mesh;
}

vtkSmartPointer<vtkPolyData> to_vtk(const TriangleMesh &mesh) {
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  for (const Eigen::Vector3d &vertex : mesh.vertices_mm) {
    points->InsertNextPoint(vertex.data());
  }
  vtkNew<vtkCellArray> cells;
  for (const Eigen::Vector3i &triangle : mesh.triangles) {
    const vtkIdType corners[] = {triangle[0], triangle[1], triangle[2]};
    cells->InsertNextCell(3, corners);
  }
  auto data = vtkSmartPointer<vtkPolyData>::New();
  data->SetPoints(points);
  data->SetPolys(cells);
  return data;
}

class NearestPoint {
public:
  explicit NearestPoint(vtkSmartPointer<vtkPolyData> data) : data_(std::move(data)) {
    locator_->SetDataSet(data_);
    locator_->BuildLocator();
  }
  [[nodiscard]] Eigen::Vector3d of(const Eigen::Vector3d &point_mm) {
    Eigen::Vector3d nearest = point_mm;
    vtkIdType cell = 0;
    int sub_cell = 0;
    double squared = 0.0;
    locator_->FindClosestPoint(point_mm.data(), nearest.data(), cell, sub_cell, squared);
    return nearest;
  }

private:
  vtkSmartPointer<vtkPolyData> data_;
  vtkNew<vtkStaticCellLocator> locator_;
};

void measure_distances(const TriangleMesh &full, const TriangleMesh &reduced, SurfaceReport &report) {
  NearestPoint nearest(to_vtk(reduced));
  double sum = 0.0;
  for (const Eigen::Vector3d &point : full.vertices_mm) {
    const double distance = (nearest.of(point) - point).norm();
    sum += distance;
    report.max_distance_mm = std::max(report.max_distance_mm, distance);
  }
  report.mean_distance_mm = sum / static_cast<double>(full.vertices_mm.size());
}

std::string defect_of(const MeshCheck &check) {
  return !check.closed ? "is not closed" : !check.manifold ? "is not a manifold" : "is not oriented";
}

base::Result<ExtractedSurface> surface_of(const Field &field, const SurfaceOptions &options, const Step &step) {
  step(0.0, "isosurface");
  const auto smooth = smoothed(isosurface(field.grid), options);
  const TriangleMesh full = mesh_in_image(smooth, field.grid);
  ExtractedSurface out;
  out.report.threshold = field.threshold;
  out.report.full_vertices = static_cast<int>(full.vertices_mm.size());
  const auto sound = [](const MeshCheck &check) { return check.closed && check.manifold && check.oriented; };

  step(0.3, "decimation");
  MeshCheck check = check_mesh(full);
  if (!sound(check)) {
    return base::failure("the surface " + defect_of(check));
  }
  out.mesh = full;
  const int components = check.components;
  if (out.report.full_vertices > options.vertices) {
    out.mesh = mesh_in_image(quadric_decimated(smooth, options.vertices), field.grid);
    check = check_mesh(out.mesh);
    if (!sound(check) || check.components != components) { // pinched, or a small part is lost
      step(0.5, "decimation, keeping the topology");
      out.mesh = decimated(full, options.vertices);
      check = check_mesh(out.mesh);
    }
  }
  if (!sound(check)) {
    return base::failure("the surface " + defect_of(check));
  }
  step(0.7, "comparing with the full surface");
  measure_distances(full, out.mesh, out.report);
  out.report.volume_ml = check.volume_ml;
  step(1.0, "done");
  return out;
}

template <class MakeField>
base::Result<ExtractedSurface> extract(const SurfaceOptions &options, const Progress &progress,
                                       const MakeField &make_field) {
  if (!(options.vertices >= 100 && options.closing_mm >= 0.0 && options.closing_mm <= 50.0 && options.blur_mm >= 0.0 &&
        options.blur_mm <= 10.0)) {
    return base::failure("a surface needs at least 100 vertices, a closing of 0 to 50 mm and a blur of 0 to 10 mm");
  }
  try {
    const auto field = make_field(step_within(progress, 0.0, kSegmentationShare));
    if (!field) {
      return tl::unexpected(field.error());
    }
    return surface_of(*field, options, step_within(progress, kSegmentationShare, 1.0));
  } catch (const Stopped &) {
    return base::failure("stopped");
  } catch (const std::exception &error) {
    return base::failure(error.what());
  }
}

// A head or a brain; in another unit it is not.
base::Result<void> check_extent(const Volume &volume) {
  const Eigen::Vector3d size(volume.size[0], volume.size[1], volume.size[2]);
  const Eigen::Vector3d extent_mm = size.cwiseProduct(volume.spacing_mm());
  if (extent_mm.maxCoeff() >= kLeastExtent_mm && extent_mm.maxCoeff() <= kLargestExtent_mm) {
    return {};
  }
  std::array<char, 128> text{};
  (void)std::snprintf(text.data(), text.size(), "the image measures %.4g x %.4g x %.4g mm: is its unit another one?",
                      extent_mm[0], extent_mm[1], extent_mm[2]);
  return base::failure(text.data());
}

} // namespace

SurfaceOptions scalp_options() {
  SurfaceOptions options;
  options.closing_mm = 8.0; // wider than nostrils and ear canals
  options.fill_slices = true;
  return options;
}

base::Result<ExtractedSurface> extract_surface(const Volume &volume, const SurfaceOptions &options,
                                               const Progress &progress) {
  if (auto human = check_extent(volume); !human) {
    return tl::unexpected(human.error());
  }
  return extract(options, progress, [&](const Step &step) { return object_field(volume, options, step); });
}

base::Result<ExtractedSurface> extract_surface(const LabelVolume &volume, std::span<const std::int16_t> labels,
                                               const SurfaceOptions &options, const Progress &progress) {
  return extract(options, progress, [&](const Step &step) { return region_field(volume, labels, options, step); });
}

std::vector<Eigen::Vector3d> nearest_on_surface(const TriangleMesh &mesh, std::span<const Eigen::Vector3d> points_mm) {
  NearestPoint nearest(to_vtk(mesh));
  std::vector<Eigen::Vector3d> out;
  for (const Eigen::Vector3d &point : points_mm) {
    out.push_back(nearest.of(point));
  }
  return out;
}

} // namespace bregma::casefile
