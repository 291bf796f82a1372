// Writes snapshots on another thread, so that the session does not wait for the disk. A snapshot that still waits is
// replaced by a newer one. Threads: one at a time.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "server/session/snapshot.hpp"
#include "server/session/work.hpp"

namespace bregma::server {

class SnapshotSaver {
public:
  SnapshotSaver(SnapshotFile file, Executor executor);

  // version: above those before. Without an executor it is written on return.
  void save(const SessionData &data, std::uint64_t version);

  struct Outcome {
    std::uint64_t version = 0;        // of the latest snapshot that was written, or could not be
    std::optional<std::string> error; // why it could not be
  };
  [[nodiscard]] Outcome outcome() const;

private:
  struct State;
  std::shared_ptr<State> state_; // shared with the job
  Executor executor_;
};

} // namespace bregma::server
