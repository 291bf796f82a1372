#include "server/stages/loaded_case.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/tissue/brain_model.hpp"
#include "server/stages/deformation/nodal_fields.hpp"

namespace bregma::server {
namespace {

std::vector<planning::NamedMesh> named_meshes(const casefile::Case &a_case) {
  std::vector<planning::NamedMesh> out;
  for (const casefile::Surface &structure : a_case.structures) {
    out.push_back({structure.name, structure.mesh});
  }
  return out;
}

inputs::KnownTools known_tools(const casefile::Case &a_case) {
  std::vector<std::string> names;
  for (const casefile::ToolModel &tool : a_case.tools) {
    names.push_back(tool.name);
  }
  const auto known = inputs::known_tools(names);
  if (!known) {
    throw std::invalid_argument("tools: at most " + std::to_string(bregma_wire_MAX_TOOLS) +
                                " fit into a tracker frame");
  }
  return *known;
}

registration::RegistrationOptions options_of(const casefile::Case &a_case, double correlation_length_mm) {
  registration::RegistrationOptions options;
  options.surface_sigma_mm = a_case.limits.surface_sigma_mm;
  options.max_target_tre_mm = a_case.limits.max_target_tre_mm;
  options.correlation_length_mm = correlation_length_mm;
  options.excess_sigma_mm = 0.0;
  if (a_case.robot) {
    for (const casefile::RangeSensorModel &sensor : a_case.robot->equipment.sensors) {
      options.excess_sigma_mm = std::max(options.excess_sigma_mm, sensor.excess_mm);
    }
  }
  return options;
}

} // namespace

LoadedCase::LoadedCase(std::shared_ptr<const casefile::Case> loaded, double correlation_length_mm,
                       int max_surface_samples)
    : data(std::move(loaded)), scalp(data->scalp.mesh), structures(named_meshes(*data)), tools(known_tools(*data)),
      estimator(&scalp, options_of(*data, correlation_length_mm), max_surface_samples) {}

LoadedCase::~LoadedCase() = default;

} // namespace bregma::server
