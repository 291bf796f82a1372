#include "clients/cli/daemon_link.hpp"

#include <random>

#include <unistd.h>

namespace bregma::cli {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using base::failure;
using base::Result;

// Makes the client's name unique: two clients with one name would receive each other's replies.
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

} // namespace

std::int64_t utc_now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

DaemonLink::DaemonLink(std::uint32_t domain)
    : domain_(domain), client_(unique_client_name()), participant_(domain), commands_(participant_),
      replies_(participant_), registration_(participant_), fiducials_(participant_), accuracy_(participant_),
      navigation_(participant_), deformation_(participant_), alarms_(participant_), health_(participant_),
      drivers_(participant_), peers_(participant_), wait_(participant_) {
  wait_.attach(replies_);
  wait_.attach(registration_);
  wait_.attach(fiducials_);
  wait_.attach(accuracy_);
  wait_.attach(navigation_);
  wait_.attach(deformation_);
  wait_.attach(alarms_);
  wait_.attach(health_);
  wait_.attach(drivers_);
}

base::Error DaemonLink::no_daemon() const {
  return {"no bregmad answers on domain " + std::to_string(domain_) + ": " +
          (snapshot_.other_wire.empty() ? "is it running?" : snapshot_.other_wire)};
}

bool DaemonLink::speaks_our_wire() const {
  return snapshot_.health && snapshot_.health->wire_generation == wire::kWireVersion.generation;
}

bool DaemonLink::take_all() {
  std::size_t news = 0;
  const auto take = [&news](auto &reader, auto &&visit) {
    news += reader.take_each([&](const auto &sample, const dds::SampleInfo &) { visit(sample); });
    (void)reader.status(); // clears the status: a change of liveliness would keep the wait set triggered
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
  take(drivers_, [&](const auto &sample) { snapshot_.drivers[wire::text(sample.device)] = sample; });
  peers_.update();
  snapshot_.other_wire = dds::other_wire_text(peers_.of_another_wire());
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
  // The other instances of a topic follow its first one.
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
    const bool there = alive(utc_now_ns()) && commands_.matched_readers() > 0 && replies_.matched_writers() > 0;
    if (there && !speaks_our_wire()) {
      return tl::unexpected(no_daemon());
    }
    if (there) {
      return {};
    }
    if (Clock::now() >= end) {
      if (const auto quiet = silence(utc_now_ns()); quiet && health_.matched_writers() > 0) {
        return failure("bregmad on domain " + std::to_string(domain_) +
                       " does not respond: its last message was sent " +
                       seconds_text(std::chrono::duration_cast<std::chrono::seconds>(*quiet)) + " ago");
      }
      return tl::unexpected(no_daemon());
    }
  }
}

Result<wire::CommandReply> DaemonLink::send(wire::Command command, Duration timeout) {
  if (auto there = wait_for_daemon(); !there) {
    return tl::unexpected(there.error());
  }
  (void)wire::set_name(command.client, client_); // it was made to fit
  command.id = next_id_++;
  command.sent_time_ns = utc_now_ns();
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
                     "; it is not known whether it carried out the command");
    }
    (void)update(20ms);
  }
}

Result<wire::Command> make_command(wire::CommandKind kind, std::initializer_list<std::string_view> values) {
  wire::Command command{};
  if (const std::string wrong = wire::fill_command(command, kind, values); !wrong.empty()) {
    return failure(wrong);
  }
  return command;
}

} // namespace bregma::cli
