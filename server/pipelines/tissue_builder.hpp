// Makes the tissue model of a case: fills its brain with tetrahedra, which takes about a second. For a thread of its
// own; the deformation loop goes on meanwhile and says that the model is being built.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "case_model/case_tissue.hpp"
#include "server/pipelines/deformation.hpp"

namespace bregma::server {

struct TissueSettings {
  int elements = 20000; // of the lattice; 0: no model
  double entry_edge_mm = case_model::BrainMeshOptions{}.entry_edge_mm;
  tissue::BrainModelOptions model;                                // its material for cases that name none
  double craniotomy_radius_mm = case_model::kCraniotomyRadius_mm; // for cases that do not say
};

class TissueBuilder {
public:
  explicit TissueBuilder(const TissueSettings &settings) : settings_(settings) {}

  void handle(const CaseChanged &change) noexcept;
  // Builds when a case waits for it; nothing when there is nothing to do. Its why() says what stood against a model.
  [[nodiscard]] std::optional<TissueModelReady> build();
  [[nodiscard]] const std::string &why() const noexcept { return why_; }
  // Frees the models of cases before this generation, which the deformation loop has left behind.
  void free_before(std::uint64_t generation);

  [[nodiscard]] std::uint64_t case_generation() const noexcept { return generation_; }

private:
  TissueSettings settings_;
  const LoadedCase *case_ = nullptr;
  std::uint64_t generation_ = 0;
  std::string why_;
  std::vector<std::pair<std::uint64_t, std::unique_ptr<tissue::BrainModel>>> models_;
};

} // namespace bregma::server
