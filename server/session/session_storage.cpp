// What the session keeps on disk and reads from there: snapshots, the restart, and case folders. Other threads do the
// work (work.hpp); the session polls.
#include <algorithm>
#include <cmath>
#include <utility>

#include "server/session/session_core.hpp"

namespace bregma::server {
namespace {

// Interval for samples that arrive without a command, and for the next attempt if the disk fails.
constexpr std::int64_t kSaveInterval_ns = 1'000'000'000;
// A snapshot that takes longer raises an alarm.
constexpr std::int64_t kSlowDisk_ns = 2'000'000'000;
// Between attempts to load the case of the last session.
constexpr std::int64_t kRestoreInterval_ns = 2'000'000'000;

} // namespace

void Session::Impl::save() {
  if (saving_ == version_ || restoring_) { // the snapshot of the last process must not be replaced yet
    return;
  }
  if (saving_ == saved_) {
    waiting_since_ns_ = now_ns;
  }
  saving_ = version_;
  submitted_ns_ = now_ns;
  saver_.save(data_, version_);
  take_saved();
}

void Session::Impl::take_saved() {
  const auto outcome = saver_.outcome();
  if (outcome.version > saved_) {
    saved_ = outcome.version;
    waiting_since_ns_ = now_ns;
    save_failed_ = outcome.error.has_value();
    // A full disk does not stop the session. An alarm states that a restart would not find this session.
    condition(alarm::kDisk, "session", save_failed_, bregma_wire_SEVERITY_CRITICAL, outcome.error.value_or(""));
  } else if (saving_ > saved_ && now_ns - waiting_since_ns_ > kSlowDisk_ns) {
    condition(alarm::kDisk, "session", true, bregma_wire_SEVERITY_CRITICAL,
              file_.path().string() + ": the disk has not answered for more than 2 s");
  }
  while (!unsaved_replies_.empty() && unsaved_replies_.front().version <= saved_) {
    const PendingReply pending = unsaved_replies_.front();
    unsaved_replies_.pop_front();
    publish_reply(pending.ticket, pending.reply);
  }
}

void Session::Impl::poll_storage() {
  poll_loading();
  poll_restoring();
  take_saved();
  if (now_ns >= submitted_ns_ + kSaveInterval_ns) {
    if (save_failed_ && saving_ == saved_) {
      changed(); // the same data once more
    }
    save();
  }
}

void Session::Impl::set_recording(const std::filesystem::path &file) {
  data_.recording = file.string();
  changed();
  save();
}

std::string Session::Impl::late_text(const std::string &folder) const {
  return folder + ": was not loaded within " + std::to_string(std::llround(config_.load_timeout_ms * 1e-3)) +
         " s: is its disk reachable?";
}

void Session::Impl::start_loading(const std::string &folder, const Ticket &ticket) {
  load_ = PendingLoad{.folder = folder,
                      .result = load_folder(folder, ports_.preparation(), executor_),
                      .deadline_ns = now_ns + std::llround(config_.load_timeout_ms * kNanosecondsPerMs),
                      .ticket = ticket};
  poll_loading();
}

void Session::Impl::poll_loading() {
  if (!load_) {
    return;
  }
  if (const LoadedFolder *folder = load_->result->get()) {
    end_loading(*folder);
  } else if (now_ns >= load_->deadline_ns) {
    LoadedFolder late;
    late.error = late_text(load_->folder);
    end_loading(late);
  }
}

void Session::Impl::end_loading(const LoadedFolder &folder) {
  const PendingLoad load = std::move(*load_); // owns the folder
  load_.reset();
  const auto by_state = machine_.refusal(load.ticket.kind); // the state may have changed in the meantime
  answer(load.ticket, !folder.error.empty() ? refused(folder.error)
                      : by_state            ? Answer{bregma_wire_COMMAND_REFUSED_BY_STATE, *by_state}
                                            : take_case(folder));
}

void Session::Impl::restore() {
  auto last = file_.load();
  if (last && *last && (*last)->stage != bregma_wire_SESSION_IDLE) {
    restoring_ = PendingRestore{.data = std::move(**last), .result = nullptr, .next_ns = now_ns, .reason = {}};
    poll_restoring();
    return;
  }
  if (last && *last) {
    data_.revision = (*last)->revision;
  }
  ports_.log(last ? "no session to restore" : "the last session is not restored: " + last.error().message);
  if (!last) {
    condition(kRestore, "", true, bregma_wire_SEVERITY_WARNING,
              "The last session is not restored: " + last.error().message);
  }
  settle();
  save();
}

void Session::Impl::poll_restoring() {
  if (!restoring_) {
    return;
  }
  PendingRestore &restoring = *restoring_;
  if (!restoring.result && now_ns >= restoring.next_ns) {
    restoring.result = load_folder(restoring.data.case_folder, ports_.preparation(), executor_);
    restoring.deadline_ns = now_ns + std::llround(config_.load_timeout_ms * kNanosecondsPerMs);
  }
  if (!restoring.result) {
    return;
  }
  const auto result = restoring.result; // owns the folder
  const LoadedFolder *folder = result->get();
  if (folder == nullptr) {
    // The attempt goes on: a second one would only block another thread on the same disk.
    if (now_ns >= restoring.deadline_ns) {
      retry_restoring(late_text(restoring.data.case_folder));
    }
    return;
  }
  restoring.result.reset();
  if (!folder->error.empty()) {
    retry_restoring(folder->error);
    return;
  }
  const PendingRestore last = std::move(*restoring_);
  restoring_.reset();
  const auto restored = bring_back(last.data, *folder);
  if (!restored) {
    static_cast<void>(file_.set_aside());
    ports_.log("the last session is not restored: " + restored.error().message);
  }
  condition(kRestore, "", !restored, bregma_wire_SEVERITY_WARNING,
            restored ? "" : "The last session is not restored: " + restored.error().message);
  settle();
  save();
}

void Session::Impl::retry_restoring(const std::string &reason) {
  PendingRestore &restoring = *restoring_;
  restoring.failed = true;
  restoring.next_ns = now_ns + kRestoreInterval_ns;
  if (restoring.reason != reason) {
    restoring.reason = reason;
    ports_.log("the last session waits for its case, which is tried again: " + reason);
    condition(kRestore, "", true, bregma_wire_SEVERITY_WARNING,
              "The last session waits for its case; loading a case gives it up. " + reason);
  }
  settle();
}

void Session::Impl::end_restoring() {
  if (restoring_) {
    restoring_.reset();
    ports_.log("the last session is given up: a case is loaded. Its snapshot is kept as " + file_.set_aside().string());
  }
  condition(kRestore, "", false, bregma_wire_SEVERITY_WARNING, "");
}

base::Result<void> Session::Impl::bring_back(SessionData data, const LoadedFolder &folder) {
  const casefile::Case &the_case = *folder.loaded;
  if (the_case.id != data.case_id) {
    return base::failure(data.case_folder + " holds case " + the_case.id + " now, it was " + data.case_id);
  }
  if (folder.checksum != data.case_checksum) {
    return base::failure(data.case_folder + ": case " + the_case.id + " has changed since this session (checksum " +
                         folder.checksum + ", it was " + data.case_checksum + ")");
  }
  for (const auto &[tool, tip] : data.tips) {
    if (the_case.tool(tool) == nullptr) {
      return base::failure("tool " + tool + " is no longer in case " + the_case.id);
    }
  }
  for (const auto &[point, sample] : data.fiducials) {
    if (the_case.fiducial(point) == nullptr) {
      return base::failure("fiducial " + point + " is no longer in case " + the_case.id);
    }
  }
  ports_.use_case(folder.loaded, folder.prepared);
  case_ = folder.loaded;
  data_ = std::move(data);
  data_.checks.clear(); // the situation may have changed in between, so the operator must verify again

  send_all(RegistrationReset{data_.revision});
  for (const auto &[name, tip] : data_.tips) {
    send_tip(name, tip);
  }
  for (auto &[name, sample] : data_.fiducials) {
    sample.revision = data_.revision;
    ports_.send(RegistrationMessage(sample));
  }
  for (SurfaceSample &sample : data_.surface) {
    sample.revision = data_.revision;
    ports_.send(RegistrationMessage(sample));
  }
  show_points();
  if (data_.accepted) {
    send_all(*data_.accepted);
    condition(kVerify, "", true, bregma_wire_SEVERITY_WARNING,
              "Restored after a restart: check the landmarks and confirm before navigating.");
  }
  machine_.restore(data_.accepted ? bregma_wire_SESSION_REGISTERED
                                  : std::min(data_.stage, bregma_wire_SESSION_REGISTERING));
  changed();
  ports_.log("restored case " + case_->id + " as " + std::string(state_name(machine_.stage())) + " with " +
             std::to_string(data_.fiducials.size()) + " fiducials and " + std::to_string(data_.surface.size()) +
             " surface samples");
  return {};
}

} // namespace bregma::server
