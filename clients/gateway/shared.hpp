// What the gateway's connections have in common.
#pragma once

#include <cstdint>
#include <set>

#include "clients/gateway/answer.hpp"
#include "clients/gateway/metrics.hpp"
#include "clients/gateway/record_store.hpp"

namespace bregma::gateway {

// A socket of /state, for whoever has news.
class Watcher {
public:
  virtual ~Watcher() = default;
  virtual void pump() = 0; // sends the next frame, if it may and there is one
  [[nodiscard]] virtual std::uint64_t seen() const = 0;
  [[nodiscard]] virtual bool wants_field() const = 0;
  [[nodiscard]] virtual bool wants_slices() const = 0;
};

// What all connections have in common.
struct Shared {
  Site site;
  RecordStore store;
  Metrics metrics;
  std::set<Watcher *> watchers;
};

} // namespace bregma::gateway
