// The deformation pipeline: its loop and topic exist, the tissue model does not yet. It says so for every target and
// makes nothing up. One thread; no allocation.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "server/pipelines/loaded_case.hpp"
#include "server/pipelines/wire_values.hpp"

namespace bregma::server {

class DeformationPipeline {
public:
  void handle(const CaseChanged &change) noexcept {
    generation_ = change.generation;
    count_ = 0;
    if (change.loaded == nullptr) {
      return;
    }
    for (const casefile::NamedPoint &target : change.loaded->data->targets) {
      if (count_ == states_.size()) {
        break;
      }
      wire::DeformationState &state = states_[count_++];
      state = {};
      (void)wire::set_name(state.target, target.name);
      state.status = bregma_wire_DEFORMATION_NO_MODEL;
      put_unknown(state.displaced_target_mm);
      state.error_bound_mm = wire::kUnknown;
    }
  }

  void step(std::int64_t now_ns) noexcept {
    for (std::size_t i = 0; i < count_; ++i) {
      states_[i].time_ns = now_ns;
    }
  }

  [[nodiscard]] std::span<const wire::DeformationState> states() const noexcept { return {states_.data(), count_}; }
  [[nodiscard]] std::uint64_t case_generation() const noexcept { return generation_; }

private:
  std::array<wire::DeformationState, bregma_wire_MAX_TARGETS> states_{};
  std::size_t count_ = 0;
  std::uint64_t generation_ = 0;
};

} // namespace bregma::server
