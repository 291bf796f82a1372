#include "server/stages/tissue_model/tissue_builder.hpp"

#include <memory>
#include <utility>
#include <vector>

#include "server/stages/deformation/nodal_fields.hpp"

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
  if (!settings_.model_wanted) {
    why_ = "deformation.elements is 0";
    return ready;
  }
  if (data.brain.mesh.triangles.empty()) {
    why_ = "no tissue model: the case has no brain";
    return ready;
  }
  const auto brain = case_model::brain_of(data, settings_.brain);
  if (!brain) {
    why_ = brain.error().message;
    return ready;
  }
  std::vector<Eigen::Vector3d> points; // in the order of DeformationPipeline::states()
  for (const auto *named : {&data.targets, &data.brain_landmarks}) {
    for (const casefile::NamedPoint &point : *named) {
      points.push_back(point.position_mm);
    }
  }
  auto model = case_model::brain_model_of(data, *brain, points, settings_.model);
  if (!model) {
    why_ = model.error().message;
    return ready;
  }
  loaded.tissue_model = std::move(*model);
  loaded.nodal_fields = std::make_unique<NodalFields>(loaded.tissue_model->solver());
  ready.model = loaded.tissue_model.get();
  ready.fields = loaded.nodal_fields.get();
  return ready;
}

} // namespace bregma::server
