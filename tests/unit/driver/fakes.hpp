// Fakes of DDS, host and device, with which the driver's loop runs in virtual time.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/frame/device.hpp"
#include "drivers/frame/io.hpp"
#include "drivers/frame/loop.hpp"

namespace bregma::driver::test {

inline constexpr std::int64_t kMs = 1'000'000;
inline constexpr std::int64_t kSecond = 1'000 * kMs;
inline constexpr std::int64_t kStart_ns = 1'700'000'000 * kSecond;

// Accepts only range samples; refuses all while `refuses` is set.
class FakeBus final : public Bus {
public:
  bool write(std::string_view topic, const void *sample) override {
    if (topic == wire::Topic<wire::RangeSample>::kName && !refuses) {
      written.push_back(*static_cast<const wire::RangeSample *>(sample));
      return true;
    }
    return topic == wire::Topic<wire::DriverHealth>::kName;
  }
  void take(std::string_view topic, const std::function<void(const void *)> &visit) override {
    if (topic == wire::Topic<wire::CommandReply>::kName) {
      for (const auto &reply : std::exchange(replies, {})) {
        visit(&reply);
      }
    }
  }
  [[nodiscard]] std::uint32_t matched(std::string_view topic) const override {
    return topic == wire::Topic<wire::RangeSample>::kName ? 3 : 0;
  }

  bool refuses = false;
  std::vector<wire::RangeSample> written;
  std::vector<wire::CommandReply> replies;
};

// Waiting takes no real time. The driver must stop at stop_ns.
class FakeHost final : public Host {
public:
  [[nodiscard]] std::int64_t now_ns() const override { return now; }
  [[nodiscard]] wire::WriteTime write_time() const override {
    return {
        .boot_id = {7}, .boot_ns = now - kStart_ns + kSecond, .wall_ns = now + wall_lead_ns, .wall_error_ns = 2 * kMs};
  }
  bool wait_until(std::int64_t time_ns) override {
    waits_ns.push_back(time_ns - now);
    now = std::min(std::max(now, time_ns), stop_ns);
    return !stopping();
  }
  [[nodiscard]] bool stopping() const override { return now >= stop_ns; }

  std::int64_t now = kStart_ns;
  std::int64_t stop_ns = kStart_ns + 3600 * kSecond;
  std::int64_t wall_lead_ns = 0; // steps of the wall clock
  std::vector<std::int64_t> waits_ns;
};

// A device controlled by the test.
class FakeDevice final : public Device {
public:
  Outcome<void> connect(Io &io) override {
    ++connects;
    return on_connect(io);
  }
  Outcome<Progress> read(Io &io) override { return on_read(io); }
  void disconnect() noexcept override { ++disconnects; }

  std::function<Outcome<void>(Io &)> on_connect = [](Io &) { return Outcome<void>(); };
  std::function<Outcome<Progress>(Io &)> on_read = [](Io &) { return Outcome<Progress>(Progress::kFinished); };
  int connects = 0;
  int disconnects = 0;
};

struct LogLine {
  LogLevel level;
  std::string text;
};

} // namespace bregma::driver::test
