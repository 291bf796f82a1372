// Makes the tissue model of a case: meshes its brain with tetrahedra, which takes about a second. One thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "algorithms/tissue/brain_model.hpp"
#include "case_model/brain.hpp"
#include "server/stages/loaded_case.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct TissueSettings {
  bool model_wanted = true;
  case_model::BrainSettings brain;
  tissue::BrainModelOptions model; // without the parameters of the brain
};

class TissueBuilder {
public:
  explicit TissueBuilder(const TissueSettings &settings) : settings_(settings) {}

  void handle(const CaseChanged &change) noexcept;
  // Builds the model of a waiting case and stores it there; empty if no case waits. why() states the reason if no model
  // could be built.
  [[nodiscard]] std::optional<TissueModelReady> build();
  [[nodiscard]] const std::string &why() const noexcept { return why_; }

private:
  TissueSettings settings_;
  LoadedCase *case_ = nullptr;
  std::uint64_t generation_ = 0;
  std::string why_;
};

} // namespace bregma::server
