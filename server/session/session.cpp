#include "server/session/session.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "idl/commands.hpp"
#include "idl/version.hpp"
#include "server/session/session_core.hpp"

namespace bregma::server {
namespace {

constexpr std::int64_t kSaveIntervalNs = 1'000'000'000; // interval for samples that arrive without a command
// Raised if the accepted registration has not been verified since a restart or a drift alarm.
constexpr const char *kVerify = "verification";

// Why a command of this kind is carried out by no state of this daemon; empty: it may be.
std::string unsupported(wire::CommandKind kind) {
  const wire::CommandEntry *entry = wire::find_command(kind);
  if (entry == nullptr) {
    return "command kind " + std::to_string(kind) + " is not known: this daemon speaks wire " +
           wire::text_of(wire::kWireVersion);
  }
  return StateMachine::carries_out(kind)
             ? std::string()
             : std::string("this daemon cannot ") + entry->deed + " (" + entry->name + "): it has no part that does it";
}

} // namespace

Session::Impl::Impl(SessionConfig config, SessionPorts &ports, Executor executor)
    : config_(std::move(config)), ports_(ports), executor_(std::move(executor)), file_(config_.state_directory),
      alarm_registry_([this](const wire::Alarm &alarm) { ports_.publish(alarm); }) {}

void Session::Impl::handle(const wire::Command &command) {
  if (!wire::is_terminated(command.client) || wire::view(command.client).empty()) {
    ports_.log("a command without a client's name was dropped: there is no client to answer");
    return;
  }
  if (!wire::view(command.receiver).empty() && wire::view(command.receiver) != wire::kDaemonName) {
    return; // a device carries it out and answers
  }
  const Ticket ticket{wire::text(command.client), command.id, command.sent_time_ns, command.kind};
  if (const std::string why = unsupported(command.kind); !why.empty()) {
    publish_reply(ticket, {bregma_wire_COMMAND_UNSUPPORTED, why}, false);
    return;
  }
  if (const std::string wrong = wire::malformed(command); !wrong.empty()) {
    publish_reply(ticket, {bregma_wire_COMMAND_MALFORMED, wrong}, false);
    return;
  }
  switch (reply_cache_.enter(ticket)) {
  case ReplyCache::Seen::kUnderWay:
    return;
  case ReplyCache::Seen::kAnswered:
    ports_.publish(reply_cache_.reply(ticket));
    return;
  case ReplyCache::Seen::kNew:
    break;
  }
  if (const auto refusal = machine_.refusal(ticket.kind)) {
    answer(ticket, {bregma_wire_COMMAND_REFUSED_BY_STATE, *refusal});
  } else if (const Outcome outcome = carry_out(ticket, command.body)) {
    answer(ticket, *outcome);
  }
}

void Session::Impl::answer(const Ticket &ticket, const Answer &answer) {
  if (answer.result == bregma_wire_COMMAND_DONE) {
    machine_.done(ticket.kind);
    settle();
    save();
  }
  publish_reply(ticket, answer, true);
}

void Session::Impl::publish_reply(const Ticket &ticket, const Answer &answer, bool remember) {
  wire::CommandReply reply{};
  (void)wire::set_name(reply.client, ticket.client); // it was received as a valid name
  reply.id = ticket.id;
  reply.kind = ticket.kind;
  reply.result = answer.result;
  reply.session = machine_.state();
  reply.value_mm = answer.value_mm;
  wire::set_text(reply.text, answer.text);
  if (remember) {
    reply_cache_.answer(ticket, reply);
    ports_.log(ticket.client + " " + wire::command_name(ticket.kind) + ": " +
               (answer.result == bregma_wire_COMMAND_DONE ? "" : "refused: ") + answer.text);
  }
  ports_.publish(reply);
}

// Publishes changes of the state to clients and loops.
void Session::Impl::settle() {
  const SessionChanged present{machine_.state(), machine_.verified()};
  if (!announced_ || announced_->state != present.state || announced_->verified != present.verified) {
    announced_ = present;
    send_all(present);
  }
  if (plan_ && machine_.stage() != bregma_wire_SESSION_NAVIGATING) {
    plan_->on = false;
    ports_.send(NavigationMessage(*plan_));
    plan_.reset();
  }
  if (machine_.stage() != bregma_wire_SESSION_REGISTERED) {
    condition(kVerify, "", false, bregma_wire_SEVERITY_WARNING, "");
  }
  if (data_.stage != machine_.stage()) {
    data_.stage = machine_.stage();
    unsaved_ = true;
  }
}

void Session::Impl::save() {
  if (!unsaved_) {
    return;
  }
  saved_ns_ = now_ns;
  const auto saved = file_.save(data_);
  unsaved_ = !saved;
  // A full disk does not stop the session. An alarm states that a restart would not find this session.
  condition(alarm::kDisk, "session", !saved, bregma_wire_SEVERITY_CRITICAL, saved ? "" : saved.error().message);
}

void Session::Impl::condition(const char *kind, std::string_view subject, bool active, wire::AlarmSeverity severity,
                              std::string_view text) {
  AlarmCondition out{};
  (void)wire::set_name(out.kind, kind);
  (void)wire::set_name(out.subject, subject);
  out.active = active;
  out.severity = severity;
  out.time_ns = now_ns;
  wire::set_text(out.text, text);
  alarm_registry_.update(out);
}

void Session::Impl::on_condition(const AlarmCondition &condition) {
  const bool changed = alarm_registry_.update(condition);
  const std::string text(condition.text, strnlen(condition.text, sizeof condition.text));
  const std::string subject = wire::text(condition.subject);
  const std::string cause = wire::text(condition.kind) + (subject.empty() ? "" : " " + subject);
  if (changed) {
    ports_.log("alarm " + cause + (condition.active ? " raised: " + text : " cleared"));
  }
  if (!condition.active) {
    machine_.recover(cause); // for any effect: the end of a condition never degrades
  } else if (condition.effect == SessionEffect::kDegrade) {
    machine_.degrade(cause);
  } else if (condition.effect == SessionEffect::kFault) {
    machine_.fault(cause + (text.empty() ? "" : ": " + text));
  } else if (condition.effect == SessionEffect::kDemote && changed) {
    data_.checks.clear(); // made before the drift alarm
    unsaved_ = true;
    if (machine_.demote()) {
      this->condition(kVerify, "", true, bregma_wire_SEVERITY_WARNING,
                      "The registration is no longer verified (" + cause +
                          "): check the landmarks and confirm, or register anew.");
    }
  }
  settle();
  save();
}

void Session::Impl::poll() {
  const PivotRun *run = pivot_ ? &*pivot_ : nullptr;
  if (run != nullptr && pivot_ticket_ && run->result() != nullptr) {
    const Ticket ticket = *pivot_ticket_;
    answer(ticket, take_pivot(*run->result()));
  }
  if (capture_ && now_ns >= capture_->deadline_ns) {
    const Ticket ticket = capture_->ticket;
    capture_.reset();
    answer(ticket, refused("the navigation loop has not answered"));
  }
  if (accept_ && now_ns >= accept_->deadline_ns) {
    const Ticket ticket = accept_->ticket;
    accept_.reset();
    answer(ticket, refused("the registration loop has not answered: no estimate of the latest samples"));
  }
  if (now_ns >= saved_ns_ + kSaveIntervalNs) {
    save();
  }
}

void Session::Impl::set_recording(const std::filesystem::path &file) {
  data_.recording = file.string();
  unsaved_ = true;
  save();
}

void Session::Impl::restore() {
  auto loaded = file_.load();
  if (!loaded) {
    ports_.log("the last session is not restored: " + loaded.error().message);
  } else if (*loaded && (*loaded)->stage != bregma_wire_SESSION_IDLE) {
    if (const auto restored = bring_back(std::move(**loaded)); !restored) {
      file_.set_aside();
      ports_.log("the last session is not restored: " + restored.error().message);
    }
  } else {
    if (*loaded) {
      data_.revision = (*loaded)->revision;
    }
    ports_.log("no session to restore");
  }
  settle();
  save();
}

base::Result<void> Session::Impl::bring_back(SessionData data) {
  auto loaded = casefile::load_case(data.case_folder);
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  const casefile::Case &the_case = *loaded;
  if (the_case.id != data.case_id) {
    return base::failure(data.case_folder + " holds case " + the_case.id + " now, it was " + data.case_id);
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
  auto shared = std::make_shared<const casefile::Case>(std::move(*loaded));
  if (auto used = ports_.use_case(shared); !used) {
    return used;
  }
  case_ = std::move(shared);
  data_ = std::move(data);
  data_.checks.clear(); // the situation may have changed in between, so the operator must verify again

  send_all(RegistrationReset{data_.revision});
  for (const auto &[name, tip] : data_.tips) {
    ToolTip message{{}, tip.tip_mm, tip.covariance_mm2};
    (void)wire::set_name(message.tool, name);
    ports_.send(NavigationMessage(message));
  }
  for (auto &[name, sample] : data_.fiducials) {
    sample.revision = data_.revision;
    ports_.send(RegistrationMessage(sample));
    show(captured_point(sample, bregma_wire_CAPTURE_FIDUCIAL_TOUCH, name));
  }
  for (SurfaceSample &sample : data_.surface) {
    sample.revision = data_.revision;
    ports_.send(RegistrationMessage(sample));
    show(captured_point(sample, bregma_wire_CAPTURE_SURFACE, ""));
  }
  if (data_.accepted) {
    send_all(*data_.accepted);
    condition(kVerify, "", true, bregma_wire_SEVERITY_WARNING,
              "Restored after a restart: check the landmarks and confirm before navigating.");
  }
  machine_.restore(data_.accepted ? bregma_wire_SESSION_REGISTERED
                                  : std::min(data_.stage, bregma_wire_SESSION_REGISTERING));
  unsaved_ = true;
  ports_.log("restored case " + case_->id + " as " + std::string(state_name(machine_.stage())) + " with " +
             std::to_string(data_.fiducials.size()) + " fiducials and " + std::to_string(data_.surface.size()) +
             " surface samples");
  return {};
}

Session::Session(SessionConfig config, SessionPorts &ports, Executor executor)
    : impl_(std::make_unique<Impl>(std::move(config), ports, std::move(executor))) {}
Session::~Session() = default;

void Session::restore(std::int64_t now_ns) {
  impl_->now_ns = now_ns;
  impl_->restore();
}

void Session::handle(const wire::Command &command, std::int64_t now_ns) {
  impl_->now_ns = now_ns;
  impl_->handle(command);
}

void Session::on(const NavigationEvent &event, std::int64_t now_ns) {
  impl_->now_ns = now_ns;
  if (const auto *capture = std::get_if<CaptureResult>(&event)) {
    impl_->on_capture(*capture);
  } else if (const auto *surface = std::get_if<SurfaceSample>(&event)) {
    impl_->on_surface(*surface);
  } else if (const auto *pose = std::get_if<PivotPose>(&event)) {
    impl_->on_pivot_pose(*pose);
  }
}

void Session::on(const wire::RegistrationState &estimate, std::int64_t now_ns) {
  impl_->now_ns = now_ns;
  impl_->on_estimate(estimate);
}

void Session::on(const AlarmCondition &condition, std::int64_t now_ns) {
  impl_->now_ns = now_ns;
  impl_->on_condition(condition);
}

void Session::poll(std::int64_t now_ns) {
  impl_->now_ns = now_ns;
  impl_->poll();
}

void Session::recording_to(const std::filesystem::path &file) { impl_->set_recording(file); }

wire::SessionState Session::state() const { return impl_->machine().state(); }
std::shared_ptr<const casefile::Case> Session::loaded_case() const { return impl_->loaded_case(); }
const SessionData &Session::data() const { return impl_->data(); }

} // namespace bregma::server
