#include "clients/cli/daemon_link.hpp"

#include <random>

#include <unistd.h>

namespace bregma::cli {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using base::failure;
using base::Result;

// Two clients with one name would take each other's replies.
std::string unique_client_name() {
  std::random_device random;
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string suffix;
  for (int i = 0; i < 8; ++i) {
    suffix += kDigits[random() % kDigits.size()];
  }
  return "cli-" + std::to_string(getpid()) + "-" + suffix;
}

std::string seconds_text(DaemonLink::Duration duration) {
  const auto milliseconds = std::chrono::duration_cast<std::chrono::milliseconds>(duration).count();
  return milliseconds % 1000 == 0 ? std::to_string(milliseconds / 1000) + " s" : std::to_string(milliseconds) + " ms";
}

std::string too_long(std::string_view what, std::string_view text, std::size_t limit) {
  return std::string(what) + " '" + std::string(text) + "' is too long: " + std::to_string(text.size()) +
         " bytes, at most " + std::to_string(limit);
}

Result<void> put(wire::Name &field, std::string_view what, std::string_view text) {
  if (text.empty()) {
    return failure(std::string(what) + " is empty");
  }
  if (!wire::set_name(field, text)) {
    return failure(too_long(what, text, wire::kNameLength));
  }
  return {};
}

wire::CommandBody body_of(wire::CommandKind kind) {
  wire::CommandBody body{};
  body._d = kind;
  return body;
}

} // namespace

std::int64_t utc_now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

DaemonLink::DaemonLink(std::uint32_t domain)
    : domain_(domain), client_(unique_client_name()), participant_(domain), commands_(participant_),
      replies_(participant_), registration_(participant_), fiducials_(participant_), accuracy_(participant_),
      navigation_(participant_), deformation_(participant_), alarms_(participant_), health_(participant_),
      wait_(participant_) {
  wait_.attach(replies_);
  wait_.attach(registration_);
  wait_.attach(fiducials_);
  wait_.attach(accuracy_);
  wait_.attach(navigation_);
  wait_.attach(deformation_);
  wait_.attach(alarms_);
  wait_.attach(health_);
}

base::Error DaemonLink::no_daemon() const {
  return {"no bregmad answers on domain " + std::to_string(domain_) + ": is it running?"};
}

bool DaemonLink::take_all() {
  std::size_t news = 0;
  const auto take = [&news](auto &reader, auto &&visit) {
    news += reader.take_each([&](const auto &sample, const dds::SampleInfo &) { visit(sample); });
    (void)reader.status(); // else a change of liveliness would keep the wait set awake
  };
  take(replies_, [&](const wire::CommandReply &reply) {
    if (wire::view(reply.client) == client_) {
      arrived_replies_[reply.id] = reply;
    }
  });
  take(registration_, [&](const auto &sample) { snapshot_.registration = sample; });
  take(fiducials_, [&](const auto &sample) { snapshot_.fiducials = sample; });
  take(accuracy_, [&](const auto &sample) { snapshot_.accuracy = sample; });
  take(navigation_, [&](const auto &sample) { snapshot_.tools[wire::text(sample.tool)] = sample; });
  take(deformation_, [&](const auto &sample) { snapshot_.deformation[wire::text(sample.point)] = sample; });
  take(alarms_, [&](const auto &sample) {
    snapshot_.alarms[{wire::text(sample.kind), wire::text(sample.subject)}] = sample;
  });
  take(health_, [&](const auto &sample) { snapshot_.health = sample; });
  return news > 0;
}

bool DaemonLink::update(Duration timeout) {
  if (take_all()) {
    return true;
  }
  (void)wait_.wait(timeout);
  return take_all();
}

void DaemonLink::settle(Duration timeout) {
  const auto end = Clock::now() + timeout;
  const auto missing = [](const auto &reader, bool arrived) { return reader.matched_writers() > 0 && !arrived; };
  while (Clock::now() < end &&
         (missing(registration_, snapshot_.registration.has_value()) ||
          missing(accuracy_, snapshot_.accuracy.has_value()) || missing(navigation_, !snapshot_.tools.empty()) ||
          missing(health_, snapshot_.health.has_value()))) {
    (void)update(20ms);
  }
  // The other instances of a topic come right behind its first.
  const auto grace = Clock::now() + 100ms;
  while (Clock::now() < grace) {
    (void)update(20ms);
  }
}

std::optional<DaemonLink::Duration> DaemonLink::silence(std::int64_t now_ns) const {
  if (!snapshot_.health) {
    return std::nullopt;
  }
  return Duration(now_ns - snapshot_.health->time_ns);
}

bool DaemonLink::alive(std::int64_t now_ns) const {
  const auto quiet = silence(now_ns);
  return quiet && *quiet < kDaemonSilent;
}

Result<void> DaemonLink::wait_for_daemon(Duration timeout) {
  const auto end = Clock::now() + timeout;
  for (;;) {
    (void)update(10ms);
    if (alive(utc_now_ns()) && commands_.matched_readers() > 0 && replies_.matched_writers() > 0) {
      return {};
    }
    if (Clock::now() >= end) {
      if (const auto quiet = silence(utc_now_ns()); quiet && health_.matched_writers() > 0) {
        return failure("bregmad on domain " + std::to_string(domain_) + " hangs: it last spoke " +
                       seconds_text(std::chrono::duration_cast<std::chrono::seconds>(*quiet)) + " ago");
      }
      return tl::unexpected(no_daemon());
    }
  }
}

Result<wire::CommandReply> DaemonLink::send(const wire::CommandBody &body, Duration timeout) {
  if (auto there = wait_for_daemon(); !there) {
    return tl::unexpected(there.error());
  }
  wire::Command command{};
  if (!wire::set_name(command.client, client_)) {
    return failure(too_long("client", client_, wire::kNameLength));
  }
  command.id = next_id_++;
  command.sent_time_ns = utc_now_ns();
  command.body = body;
  if (!commands_.write(command)) {
    return failure("the command could not be sent on domain " + std::to_string(domain_));
  }
  const auto end = Clock::now() + timeout;
  for (;;) {
    const auto found = arrived_replies_.find(command.id);
    if (found != arrived_replies_.end()) {
      const wire::CommandReply reply = found->second;
      arrived_replies_.erase(found);
      return reply;
    }
    if (Clock::now() >= end) {
      return failure("bregmad on domain " + std::to_string(domain_) + " did not reply within " + seconds_text(timeout) +
                     "; whether it carried the command out is not known");
    }
    (void)update(20ms);
  }
}

Result<wire::CommandBody> plain_command(wire::CommandKind kind) { return body_of(kind); }

Result<wire::CommandBody> load_case_command(std::string_view folder) {
  auto body = body_of(bregma_wire_COMMAND_LOAD_CASE);
  auto &field = body._u.load_case.folder;
  if (folder.empty()) {
    return failure("case folder is empty");
  }
  if (folder.size() >= sizeof(field)) {
    return failure(too_long("case folder", folder, sizeof(field) - 1));
  }
  std::memcpy(field, folder.data(), folder.size());
  return body;
}

Result<wire::CommandBody> tool_command(wire::CommandKind kind, std::string_view tool) {
  auto body = body_of(kind);
  return put(body._u.tool.tool, "tool", tool).map([&] { return body; });
}

Result<wire::CommandBody> touch_command(wire::CommandKind kind, std::string_view tool, std::string_view point) {
  auto body = body_of(kind);
  return put(body._u.touch.tool, "tool", tool)
      .and_then([&] { return put(body._u.touch.point, "point", point); })
      .map([&] { return body; });
}

Result<wire::CommandBody> remove_fiducial_command(std::string_view fiducial) {
  auto body = body_of(bregma_wire_COMMAND_REMOVE_FIDUCIAL);
  return put(body._u.point.point, "fiducial", fiducial).map([&] { return body; });
}

Result<wire::CommandBody> navigate_command(std::string_view tool, std::string_view trajectory) {
  auto body = body_of(bregma_wire_COMMAND_START_NAVIGATION);
  return put(body._u.plan.tool, "tool", tool)
      .and_then([&] { return put(body._u.plan.trajectory, "trajectory", trajectory); })
      .map([&] { return body; });
}

Result<wire::CommandBody> acknowledge_command(std::string_view kind, std::string_view subject) {
  auto body = body_of(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM);
  if (!wire::set_name(body._u.alarm.subject, subject)) { // may be empty
    return failure(too_long("subject", subject, wire::kNameLength));
  }
  return put(body._u.alarm.kind, "alarm", kind).map([&] { return body; });
}

} // namespace bregma::cli
