#include "server/session/session.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "idl/commands.hpp"
#include "idl/version.hpp"
#include "server/session/session_core.hpp"

namespace bregma::server {
namespace {

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
      alarm_registry_([this](const wire::Alarm &alarm) { ports_.publish(alarm); }), saver_(file_, executor_) {}

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
    publish_reply(ticket, make_reply(ticket, {bregma_wire_COMMAND_UNSUPPORTED, why}));
    return;
  }
  if (const std::string wrong = wire::malformed(command); !wrong.empty()) {
    publish_reply(ticket, make_reply(ticket, {bregma_wire_COMMAND_MALFORMED, wrong}));
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
  const wire::CommandReply reply = make_reply(ticket, answer);
  if (answer.result == bregma_wire_COMMAND_DONE && version_ != version_before_ && version_ > saved_) {
    unsaved_replies_.push_back({version_, ticket, reply});
  } else {
    publish_reply(ticket, reply);
  }
  version_before_ = version_; // a further answer of the same call does not wait for this change
}

wire::CommandReply Session::Impl::make_reply(const Ticket &ticket, const Answer &answer) const {
  wire::CommandReply reply{};
  (void)wire::set_name(reply.client, ticket.client); // it was received as a valid name
  reply.id = ticket.id;
  reply.kind = ticket.kind;
  reply.result = answer.result;
  reply.session = machine_.state();
  reply.value_mm = answer.value_mm;
  wire::set_text(reply.text, answer.text);
  return reply;
}

void Session::Impl::publish_reply(const Ticket &ticket, const wire::CommandReply &reply) {
  reply_cache_.answer(ticket, reply);
  log_reply(ticket, reply);
  ports_.publish(reply);
}

void Session::Impl::log_reply(const Ticket &ticket, const wire::CommandReply &reply) {
  ports_.log(ticket.client + " " + std::to_string(ticket.id) + " " + wire::command_name(ticket.kind) + ": " +
             (reply.result == bregma_wire_COMMAND_DONE ? "" : "refused: ") + reply.text);
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
    changed();
  }
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
  const bool began_or_ended = alarm_registry_.update(condition);
  const std::string text(condition.text, strnlen(condition.text, sizeof condition.text));
  const std::string subject = wire::text(condition.subject);
  const std::string cause = wire::text(condition.kind) + (subject.empty() ? "" : " " + subject);
  if (!condition.active) {
    machine_.recover(cause); // for any effect: the end of a condition never degrades
  } else if (condition.effect == SessionEffect::kDegrade) {
    machine_.degrade(cause);
  } else if (condition.effect == SessionEffect::kFault) {
    machine_.fault(cause + (text.empty() ? "" : ": " + text));
  } else if (condition.effect == SessionEffect::kDemote && began_or_ended) {
    data_.checks.clear(); // made before the drift alarm
    changed();
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
  poll_checks();
  poll_passed_on();
  poll_storage();
}

Session::Session(SessionConfig config, SessionPorts &ports, Executor executor)
    : impl_(std::make_unique<Impl>(std::move(config), ports, std::move(executor))) {}
Session::~Session() = default;

void Session::restore(std::int64_t now_ns) {
  impl_->begin(now_ns);
  impl_->restore();
}

void Session::handle(const wire::Command &command, std::int64_t now_ns) {
  impl_->begin(now_ns);
  impl_->handle(command);
}

void Session::on(const NavigationEvent &event, std::int64_t now_ns) {
  impl_->begin(now_ns);
  if (const auto *capture = std::get_if<CaptureResult>(&event)) {
    impl_->on_capture(*capture);
  } else if (const auto *surface = std::get_if<SurfaceSample>(&event)) {
    impl_->on_surface(*surface);
  } else if (const auto *pose = std::get_if<PivotPose>(&event)) {
    impl_->on_pivot_pose(*pose);
  } else {
    impl_->on_arm_replaced();
  }
}

void Session::on(const RegistrationEstimate &estimate, std::int64_t now_ns) {
  impl_->begin(now_ns);
  impl_->on_estimate(estimate);
}

void Session::on(const StageAnswer &answer, std::int64_t now_ns) {
  impl_->begin(now_ns);
  impl_->on_stage_answer(answer);
}

void Session::on(const AlarmCondition &condition, std::int64_t now_ns) {
  impl_->begin(now_ns);
  impl_->on_condition(condition);
}

void Session::poll(std::int64_t now_ns) {
  impl_->begin(now_ns);
  impl_->poll();
}

void Session::recording_to(const std::filesystem::path &file) { impl_->set_recording(file); }

wire::SessionState Session::state() const { return impl_->machine().state(); }
std::shared_ptr<const casefile::Case> Session::loaded_case() const { return impl_->loaded_case(); }
const SessionData &Session::data() const { return impl_->data(); }

} // namespace bregma::server
