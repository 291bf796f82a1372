#include "server/session/snapshot_saver.hpp"

#include <exception>
#include <mutex>
#include <utility>

namespace bregma::server {
namespace {

struct Snapshot {
  SessionData data;
  std::uint64_t version;
};

} // namespace

struct SnapshotSaver::State {
  explicit State(SnapshotFile snapshot_file) : file(std::move(snapshot_file)) {}

  SnapshotFile file;
  std::mutex mutex; // guards the following; nobody holds it while the disk is used
  std::optional<Snapshot> waiting;
  bool running = false; // a job writes
  Outcome outcome;

  void write_all();
};

void SnapshotSaver::State::write_all() {
  for (;;) {
    std::optional<Snapshot> next;
    {
      const std::lock_guard lock(mutex);
      next.swap(waiting);
      running = next.has_value();
      if (!running) {
        return;
      }
    }
    std::optional<std::string> error;
    try {
      if (const auto saved = file.save(next->data); !saved) {
        error = saved.error().message;
      }
    } catch (const std::exception &problem) { // there is no memory for the text
      error = file.path().string() + ": cannot be written: " + problem.what();
    }
    const std::lock_guard lock(mutex);
    outcome = {next->version, std::move(error)};
  }
}

SnapshotSaver::SnapshotSaver(SnapshotFile file, Executor executor)
    : state_(std::make_shared<State>(std::move(file))), executor_(std::move(executor)) {}

void SnapshotSaver::save(const SessionData &data, std::uint64_t version) {
  {
    const std::lock_guard lock(state_->mutex);
    state_->waiting = {data, version};
    if (std::exchange(state_->running, true)) {
      return;
    }
  }
  execute(executor_, Work::kSave, [state = state_] { state->write_all(); });
}

SnapshotSaver::Outcome SnapshotSaver::outcome() const {
  const std::lock_guard lock(state_->mutex);
  return state_->outcome;
}

} // namespace bregma::server
