// A small daemon in this process, on a separate DDS domain.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <functional>
#include <iterator>
#include <thread>

#include <unistd.h>

#include "clients/live/daemon_link.hpp"
#include "idl/boot_clock.hpp"
#include "idl/commands.hpp"

namespace bregma::test {

inline std::uint32_t own_domain() { return 100 + static_cast<std::uint32_t>(getpid()) % 100; }

// Publishes its health and two live tools, and answers commands, like bregmad.
class FakeDaemon {
public:
  using Answer = std::function<wire::CommandReply(const wire::Command &)>;
  static constexpr std::int64_t kAge_ns = 10'000'000;      // of its poses at publication
  static constexpr std::int64_t kValidFor_ns = 90'000'000; // after that

  // clock_ns: its clock minus this host's. mark: the x of its tools' tips.
  explicit FakeDaemon(Answer answer = {}, std::int64_t clock_ns = 0, double mark = 1.0)
      : answer_(std::move(answer)), clock_ns_(clock_ns), mark_(mark), participant_(own_domain()),
        thread_([this] { run(); }) {}
  ~FakeDaemon() {
    stopping_ = true;
    thread_.join();
  }
  FakeDaemon(const FakeDaemon &) = delete;
  FakeDaemon &operator=(const FakeDaemon &) = delete;
  std::atomic<bool> speaking{true};
  std::atomic<bool> case_open{true}; // false: the tools have ended
  std::atomic<const char *> case_folder{""};
  std::atomic<int> period_ms{5}; // of the tools' states; ten of them are that of the health
  // Writers of commands that this daemon is connected to.
  [[nodiscard]] std::uint32_t commanders() const { return commanders_; }

private:
  [[nodiscard]] wire::NavigationState tool(const char *name) const {
    wire::NavigationState state{};
    (void)wire::set_name(state.tool, name);
    state.status = bregma_wire_POSE_LIVE;
    state.published_time_ns = live::Now::read().utc_ns + clock_ns_;
    state.acquired_time_ns = state.published_time_ns - kAge_ns;
    state.age_ns = kAge_ns;
    state.valid_for_ns = kValidFor_ns;
    std::copy(boot_id_.begin(), boot_id_.end(), state.boot_id);
    state.published_boot_ns = wire::boot_now_ns();
    state.T_image_tip = {{1, 0, 0, 0}, {mark_, 2, 3}};
    state.tre_rms_mm = 0.7;
    std::copy_n(std::array{1.9, 1.0, 0.6}.begin(), 3, state.tre_95.semi_axes_mm);
    std::copy_n(std::array{1.0, 0.0, 0.0, 0.0, 0.8, 0.6, 0.0, -0.6, 0.8}.begin(), 9, state.tre_95.axes);
    state.acceleration_sigma_mm_s2 = wire::kUnknown;
    return state;
  }

  void run() {
    const dds::Writer<wire::SystemHealth> health(participant_);
    const dds::Writer<wire::NavigationState> navigation(participant_);
    const dds::Writer<wire::Alarm> alarms(participant_);
    dds::Reader<wire::Command> commands(participant_);
    const dds::Writer<wire::CommandReply> replies(participant_);
    wire::Alarm alarm{};
    (void)wire::set_name(alarm.kind, "drift");
    alarm.state = bregma_wire_ALARM_RAISED;
    (void)alarms.write(alarm);
    bool was_open = false;
    for (int step = 0; !stopping_; ++step) {
      if (speaking && step % 10 == 0) {
        wire::SystemHealth sample{};
        (void)wire::set_name(sample.daemon, "bregmad");
        sample.time_ns = live::Now::read().utc_ns + clock_ns_;
        std::copy(boot_id_.begin(), boot_id_.end(), sample.boot_id);
        sample.published_boot_ns = wire::boot_now_ns();
        sample.session = bregma_wire_SESSION_VERIFIED;
        wire::set_text(sample.case_folder, case_folder.load());
        sample.wire_generation = wire::kWireVersion.generation;
        (void)health.write(sample);
      }
      for (const char *name : {"Probe", "Stylus"}) {
        if (speaking && case_open) {
          (void)navigation.write(tool(name));
        } else if (was_open && !case_open) {
          (void)navigation.end(tool(name));
        }
      }
      was_open = case_open;
      commands.take_each([&](const wire::Command &command, const dds::SampleInfo &) {
        if (answer_) {
          (void)replies.write(answer_(command));
        }
      });
      commanders_ = commands.matched_writers();
      std::this_thread::sleep_for(std::chrono::milliseconds(period_ms));
    }
  }

  Answer answer_;
  std::int64_t clock_ns_;
  double mark_;
  std::array<std::uint8_t, 16> boot_id_ = wire::boot_id();
  dds::Participant participant_;
  std::atomic<bool> stopping_{false};
  std::atomic<std::uint32_t> commanders_{0};
  std::thread thread_;
};

inline wire::CommandReply reply_to(const wire::Command &command, wire::CommandResult result, const char *text) {
  return wire::reply_to(command, result, text, bregma_wire_SESSION_NAVIGATING);
}

} // namespace bregma::test
