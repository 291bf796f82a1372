#include "server/stages/tissue_model/tissue_builder.hpp"

#include <stdexcept>
#include <utility>
#include <vector>

#include "algorithms/surface/surface_model.hpp"

namespace bregma::server {

void TissueBuilder::handle(const CaseChanged &change) noexcept {
  case_ = change.loaded;
  generation_ = change.generation;
}

std::optional<TissueModelReady> TissueBuilder::build() {
  if (case_ == nullptr) {
    return std::nullopt;
  }
  LoadedCase &loaded = *std::exchange(case_, nullptr);
  const casefile::Case &data = *loaded.data;
  TissueModelReady ready{.generation = generation_};
  why_.clear();
  if (settings_.elements == 0) {
    why_ = "deformation.elements is 0";
    return ready;
  }
  try {
    const surface::SurfaceModel brain(data.brain.mesh);
    tissue::BrainModelOptions options = settings_.model;
    options.material = case_model::material_of(data, settings_.model.material);
    options.skull.craniotomy = case_model::craniotomy_of(data, brain, settings_.craniotomy_radius_mm);
    case_model::BrainMeshOptions meshing;
    meshing.lattice.tetrahedra = settings_.elements;
    meshing.entry_edge_mm = settings_.entry_edge_mm;
    const tissue::LatticeMesh filled = case_model::brain_mesh_of(data, brain, options.skull.craniotomy, meshing);
    options.solver.minimum_step_s = case_model::min_step_s(filled, options.material);
    std::vector<Eigen::Vector3d> points; // in the order of DeformationPipeline::states()
    for (const auto *named : {&data.targets, &data.brain_landmarks}) {
      for (const casefile::NamedPoint &point : *named) {
        points.push_back(point.position_mm);
      }
    }
    loaded.tissue_model = std::make_unique<tissue::BrainModel>(filled.mesh, points, options);
    loaded.field_mm.resize(3 * static_cast<std::size_t>(loaded.tissue_model->solver().nodes()));
    ready.model = loaded.tissue_model.get();
    ready.field_mm = loaded.field_mm.data();
  } catch (const std::invalid_argument &error) {
    why_ = data.folder.string() + ": no tissue model of the brain: " + error.what();
  }
  return ready;
}

} // namespace bregma::server
