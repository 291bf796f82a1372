#include "server/stages/tissue_model/stage.hpp"

#include <exception>
#include <string>
#include <vector>

#include "server/stages/schedules.hpp"

namespace bregma::server {
namespace {

TissueSettings settings_of(const TissueModelParameters &from) {
  TissueSettings out;
  out.model_wanted = from.elements > 0;
  out.brain.mesh.lattice.tetrahedra = static_cast<int>(from.elements);
  out.brain.mesh.entry_edge_mm = from.entry_edge_mm;
  out.brain.craniotomy_radius_mm = from.craniotomy_radius_mm;
  out.brain.material = tissue::named_material(from.material);
  out.model.solver.threads = static_cast<int>(from.threads);
  out.model.skull.sliding = from.sliding;
  out.model.skull.gap_mm = from.gap_mm;
  out.model.probe.radius_mm = from.probe_radius_mm;
  out.model.insertion.rupture_force_N = from.rupture_force_N;
  out.model.insertion.cutting_force_N = from.cutting_force_N;
  out.model.insertion.shaft_friction_N_per_mm = from.shaft_friction_N_per_mm;
  return out;
}

} // namespace

void declare(base::ParameterSet &set, TissueModelParameters &p) {
  set.integer("deformation.elements", &p.elements, "", 0, 200000,
              "Approximate number of tetrahedra in the brain; 0: no tissue model.");
  set.number(
      "deformation.entry_edge_mm", &p.entry_edge_mm, "mm", 0, 20,
      "Maximum edge of the tetrahedra where a trajectory enters the brain; these are additional. 0: no refinement.");
  set.integer("deformation.threads", &p.threads, "", 1, 16, "Threads that step the tissue model together.");
  std::vector<std::string> materials;
  for (const tissue::Material &material : tissue::named_materials()) {
    materials.push_back(material.name);
  }
  set.choice("deformation.material", &p.material, materials, "Material of the brain, where the case states none.");
  set.flag("deformation.sliding", &p.sliding,
           "true: the brain slides along the skull; false: it is fixed to the skull except under the craniotomy.");
  set.number("deformation.gap_mm", &p.gap_mm, "mm", 0, 20, "Gap of fluid between brain and skull.");
  set.number("deformation.craniotomy_radius_mm", &p.craniotomy_radius_mm, "mm", 0, 100,
             "Radius of the opening around the first trajectory's entry into the brain, where the case states none.");
  set.number("deformation.probe_radius_mm", &p.probe_radius_mm, "mm", 0.2, 20, "Radius of the probe's shaft.");
  set.number("deformation.rupture_force_N", &p.rupture_force_N, "N", 0.001, 100,
             "Force along the probe at which the brain's surface ruptures.");
  set.number("deformation.cutting_force_N", &p.cutting_force_N, "N", 0, 100,
             "Force at the tip that cuts the tissue after the rupture.");
  set.number("deformation.shaft_friction_N_per_mm", &p.shaft_friction_N_per_mm, "N/mm", 0, 10,
             "Friction of the shaft in the tissue, per length.");
}

TissueModelStage::TissueModelStage(const TissueModelParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kWorker, .rate_hz = kLookRate_hz, .long_work = true}), host_(context.host),
      builder_(settings_of(parameters)) {}

void TissueModelStage::connect(CaseStore &cases) { lease_.connect(cases); }

void TissueModelStage::step(const Moment & /*now*/) noexcept {
  if (const auto change = lease_.newer()) {
    builder_.handle(*change);
    lease_.take(*change);
  }
  if (const auto ready = builder_.build()) {
    model.store(*ready);
    host_.log(LogLevel::kInfo, ready->model == nullptr
                                   ? builder_.why()
                                   : "tissue model of " + std::to_string(ready->model->solver().elements()) +
                                         " tetrahedra, step " + std::to_string(1e3 * ready->model->solver().step_s()) +
                                         " ms");
  }
}

} // namespace bregma::server
