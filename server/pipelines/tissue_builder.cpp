#include "server/pipelines/tissue_builder.hpp"

#include <stdexcept>

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
  const casefile::Case &data = *case_->data;
  case_ = nullptr;
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
    options.solver.minimum_step_s = case_model::least_step_s(filled, options.material);
    std::vector<Vector3d> points; // in the order of DeformationPipeline::states()
    for (const auto *named : {&data.targets, &data.brain_landmarks}) {
      for (const casefile::NamedPoint &point : *named) {
        points.push_back(point.position_mm);
      }
    }
    models_.emplace_back(generation_, std::make_unique<tissue::BrainModel>(filled.mesh, points, options));
    ready.model = models_.back().second.get();
  } catch (const std::invalid_argument &error) {
    why_ = data.folder.string() + ": no tissue model of the brain: " + error.what();
  }
  return ready;
}

void TissueBuilder::free_before(std::uint64_t generation) {
  std::erase_if(models_, [generation](const auto &entry) { return entry.first < generation; });
}

} // namespace bregma::server
