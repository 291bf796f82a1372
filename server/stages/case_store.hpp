// The case on its way to the stages and back: the session's stage adds cases, each stage holds a lease on the one that
// it works with, and a case is freed when no stage holds it or an earlier one any more.
//
//   lease_.connect(store);                                // at wiring
//   if (const auto change = lease_.newer()) {             // in a step of a stage that only follows the case ...
//     pipeline_.handle(*change);
//     lease_.take(*change);
//   }
//   inbox.take_each([&](const Message &m) { ... });       // ... or, where messages about the case come with it, in
//                                                         // their order: CaseChanged is one of them, then lease_.take
//
// Threads: add and free_unused by the session's; a lease by its stage's, wait-free.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "server/runtime/latest_value.hpp"
#include "server/stages/loaded_case.hpp"

namespace bregma::server {

class CaseStore {
public:
  // nullptr: no case any more.
  CaseChanged add(std::unique_ptr<LoadedCase> loaded);
  // Frees the cases that every lease has left behind.
  void free_unused();
  [[nodiscard]] std::size_t held() const noexcept { return cases_.size(); } // the present one included

private:
  friend class CaseLease;
  std::uint64_t generation_ = 0;
  std::vector<std::pair<std::uint64_t, std::unique_ptr<LoadedCase>>> cases_; // by generation, the present one last
  runtime::LatestValue<CaseChanged> latest_;
  std::deque<std::atomic<std::uint64_t>> taken_; // generation that each lease holds
};

class CaseLease {
public:
  // store: outlives the lease. Before the stages run.
  void connect(CaseStore &store);
  // The latest case if it is not the one that is held.
  [[nodiscard]] std::optional<CaseChanged> newer() const noexcept;
  // From now on this case is held. Nothing of an earlier one may be used any more.
  void take(const CaseChanged &change) noexcept;
  [[nodiscard]] std::uint64_t generation() const noexcept { return held_; }

private:
  const CaseStore *store_ = nullptr;
  std::atomic<std::uint64_t> *taken_ = nullptr;
  std::uint64_t held_ = 0;
};

} // namespace bregma::server
