#include "server/stages/case_store.hpp"

#include <algorithm>

namespace bregma::server {

CaseChanged CaseStore::add(std::unique_ptr<LoadedCase> loaded) {
  const CaseChanged change{++generation_, loaded.get()};
  cases_.emplace_back(generation_, std::move(loaded));
  latest_.store(change);
  return change;
}

void CaseStore::free_unused() {
  std::uint64_t oldest = generation_;
  for (const auto &taken : taken_) {
    oldest = std::min(oldest, taken.load(std::memory_order_acquire));
  }
  std::erase_if(cases_, [oldest](const auto &entry) { return entry.first < oldest; });
}

void CaseLease::connect(CaseStore &store) {
  store_ = &store;
  taken_ = &store.taken_.emplace_back(0);
}

std::optional<CaseChanged> CaseLease::newer() const noexcept {
  const auto latest = store_->latest_.load();
  return latest && latest->generation != held_ ? latest : std::nullopt;
}

void CaseLease::take(const CaseChanged &change) noexcept {
  held_ = change.generation;
  taken_->store(change.generation, std::memory_order_release);
}

} // namespace bregma::server
