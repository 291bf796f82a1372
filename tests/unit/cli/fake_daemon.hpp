// A small daemon in this process, on a separate DDS domain.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <iterator>
#include <thread>

#include <unistd.h>

#include "clients/cli/daemon_link.hpp"

namespace bregma::test {

inline std::uint32_t own_domain() { return 100 + static_cast<std::uint32_t>(getpid()) % 100; }

// Publishes its health and answers commands, like bregmad.
class FakeDaemon {
public:
  using Answer = std::function<wire::CommandReply(const wire::Command &)>;

  explicit FakeDaemon(Answer answer = {}) : answer_(std::move(answer)), thread_([this] { run(); }) {}
  ~FakeDaemon() {
    stopping_ = true;
    thread_.join();
  }
  FakeDaemon(const FakeDaemon &) = delete;
  FakeDaemon &operator=(const FakeDaemon &) = delete;
  std::atomic<bool> speaking{true};

private:
  void run() {
    const dds::Participant participant(own_domain());
    const dds::Writer<wire::SystemHealth> health(participant);
    const dds::Writer<wire::NavigationState> navigation(participant);
    const dds::Writer<wire::Alarm> alarms(participant);
    dds::Reader<wire::Command> commands(participant);
    const dds::Writer<wire::CommandReply> replies(participant);
    wire::Alarm alarm{};
    (void)wire::set_name(alarm.kind, "drift");
    alarm.state = bregma_wire_ALARM_RAISED;
    (void)alarms.write(alarm);
    for (const char *tool : {"Probe", "Stylus"}) {
      wire::NavigationState state{};
      (void)wire::set_name(state.tool, tool);
      state.published_time_ns = cli::utc_now_ns();
      (void)navigation.write(state);
    }
    while (!stopping_) {
      if (speaking) {
        wire::SystemHealth sample{};
        (void)wire::set_name(sample.daemon, "bregmad");
        sample.time_ns = cli::utc_now_ns();
        sample.session = bregma_wire_SESSION_VERIFIED;
        sample.wire_generation = wire::kWireVersion.generation;
        (void)health.write(sample);
      }
      for (int i = 0; i < 10; ++i) {
        commands.take_each([&](const wire::Command &command, const dds::SampleInfo &) {
          if (answer_) {
            (void)replies.write(answer_(command));
          }
        });
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
    }
  }

  Answer answer_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

inline wire::CommandReply reply_to(const wire::Command &command, wire::CommandResult result, const char *text) {
  wire::CommandReply out{};
  std::copy(std::begin(command.client), std::end(command.client), out.client);
  out.id = command.id;
  out.kind = command.kind;
  out.result = result;
  out.session = bregma_wire_SESSION_NAVIGATING;
  out.value_mm = wire::kUnknown;
  out.value_mm = wire::kUnknown;
  wire::set_text(out.text, text);
  return out;
}

} // namespace bregma::test
