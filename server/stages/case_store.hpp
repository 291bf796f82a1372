// Shares cases between the stages. The session's stage adds cases, each stage holds a lease on the one that it uses,
// and a case is freed when no stage holds it or an earlier one.
//
//   lease_.connect(store);                                // at wiring
//   if (const auto change = lease_.newer()) {             // in a step of a stage that only follows the case ...
//     pipeline_.handle(*change);
//     lease_.take(*change);
//   }
//   inbox.take_each([&](const Message &m) { ... });       // ... or in the order of messages about the case, one of
//                                                         // which is CaseChanged, then lease_.take
//
// Threads: the session's calls add and free_unused; a stage's thread uses its lease, wait-free.
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
  // nullptr: the case was closed.
  CaseChanged add(std::unique_ptr<LoadedCase> loaded);
  // Frees the cases that no lease holds any more.
  void free_unused();
  [[nodiscard]] std::size_t held() const noexcept { return cases_.size(); } // including the current one

private:
  friend class CaseLease;
  std::uint64_t generation_ = 0;
  std::vector<std::pair<std::uint64_t, std::unique_ptr<LoadedCase>>> cases_; // per generation, the current one last
  runtime::LatestValue<CaseChanged> latest_;
  std::deque<std::atomic<std::uint64_t>> taken_; // generation that each lease holds
};

class CaseLease {
public:
  // store must outlive the lease. To be called before the stages run.
  void connect(CaseStore &store);
  // The latest case if it is not the held one.
  [[nodiscard]] std::optional<CaseChanged> newer() const noexcept;
  // Holds this case from now on. Earlier cases must not be used any more.
  void take(const CaseChanged &change) noexcept;
  [[nodiscard]] std::uint64_t generation() const noexcept { return held_; }

private:
  const CaseStore *store_ = nullptr;
  std::atomic<std::uint64_t> *taken_ = nullptr;
  std::uint64_t held_ = 0;
};

} // namespace bregma::server
