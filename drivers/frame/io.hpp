// Environment of a device: its topics, the host's clock, and the request to stop.
//
// Two small interfaces hide DDS and the operating system, so that devices and the driver's loop are tested without
// them: a Bus transfers samples, a Host has the clock. dds_bus.hpp and system_host.hpp implement them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "base/device_clock.hpp"
#include "drivers/frame/status.hpp"
#include "idl/host_clock.hpp"
#include "idl/names.hpp"
#include "idl/topics.hpp"

namespace bregma::driver {

// Topics are those of the topic table (idl/topics.hpp), by name. A sample must be of the topic's type.
class Bus {
public:
  virtual ~Bus() = default;
  // False if the sample was refused, for example because the driver does not write this topic.
  [[nodiscard]] virtual bool write(std::string_view topic, const void *sample) = 0;
  // Visits samples received since the last call, oldest first. They are valid only during visit.
  virtual void take(std::string_view topic, const std::function<void(const void *)> &visit) = 0;
  // Readers of a topic that the driver writes, writers of a topic that it takes.
  [[nodiscard]] virtual std::uint32_t matched(std::string_view topic) const = 0;
};

// Threads: any.
class Host {
public:
  virtual ~Host() = default;
  // Steady UTC in ns: CLOCK_BOOTTIME plus a constant, the wall clock at the start. It never steps (docs/time.md).
  [[nodiscard]] virtual std::int64_t now_ns() const = 0;
  [[nodiscard]] virtual wire::WriteTime write_time() const = 0;
  // True at that time; false at once if the driver must stop.
  [[nodiscard]] virtual bool wait_until(std::int64_t time_ns) = 0;
  [[nodiscard]] virtual bool stopping() const = 0;
};

struct IoOptions {
  std::string device;                  // name for samples without one; at most wire::kNameLength bytes
  bool map_device_time = true;         // false: device_time_ns is published unchanged
  std::int64_t minimum_latency_ns = 0; // minimum latency from the device's exposure to its driver
};

// Concept of a device's sample, with the fields that the frame completes.
template <class T>
concept DeviceSample = requires(T sample) {
  sample.device;
  sample.frame;
  sample.device_time_ns;
  sample.sent_time_ns;
};

// Samples of the loops state the clocks of the write, too.
template <class T>
concept StatesWriteTime = requires(T sample) {
  sample.sent_boot_ns;
};

// Threads: the loop's. Only the visitors of take() may throw.
class Io {
public:
  Io(Bus &bus, Host &host, Status &status, IoOptions options);

  // Sends one sample. Of a device's sample the device fills frame (its own count, or one up per sample), device_time_ns
  // (its own clock; the time of arrival where it has none) and period_ns; the frame fills device, maps device_time_ns
  // to this host's clock, and states the time of the write. arrival_ns: time of arrival of the bytes, by now_ns(); 0:
  // now. False if the sample was dropped: inconsistent with the device's clock, or refused by DDS. Both are counted.
  template <class T> bool publish(T sample, std::int64_t arrival_ns = 0) {
    if constexpr (DeviceSample<T>) {
      std::int64_t period_ns = 0;
      if constexpr (requires { sample.period_ns; }) {
        period_ns = sample.period_ns;
      }
      if (!prepare(wire::Topic<T>::kName, sample.device, sample.device_time_ns, period_ns, arrival_ns)) {
        return false;
      }
      const wire::WriteTime write = host_->write_time();
      sample.sent_time_ns = write.wall_ns;
      if constexpr (StatesWriteTime<T>) {
        std::copy(write.boot_id.begin(), write.boot_id.end(), sample.boot_id);
        sample.sent_boot_ns = write.boot_ns;
        sample.sent_clock_error_ns = write.wall_error_ns;
      }
    }
    return write(wire::Topic<T>::kName, &sample);
  }

  // Calls visit(const T &) for every sample received since the last call.
  template <class T, class Visit> void take(Visit &&visit) {
    bus_->take(wire::Topic<T>::kName, [&visit](const void *sample) { visit(*static_cast<const T *>(sample)); });
  }

  // Readers of a topic that the device writes, writers of a topic that it takes.
  template <class T> [[nodiscard]] std::uint32_t matched() const { return bus_->matched(wire::Topic<T>::kName); }

  // Input that the protocol cannot read was skipped. Counted; the latest reason is reported once per second.
  void skipped(std::uint64_t count, std::string_view reason);

  [[nodiscard]] std::int64_t now_ns() const { return host_->now_ns(); }
  [[nodiscard]] bool wait_until(std::int64_t time_ns) { return host_->wait_until(time_ns); }
  [[nodiscard]] bool stopping() const { return host_->stopping(); }

  // For the loop: the device's clock may have changed.
  void start_connection();

private:
  // Completes the name and maps the time. False if the time contradicts the device's clock.
  [[nodiscard]] bool prepare(std::string_view topic, wire::Name &device, std::int64_t &device_time_ns,
                             std::int64_t period_ns, std::int64_t arrival_ns);
  [[nodiscard]] bool write(std::string_view topic, const void *sample);

  Bus *bus_;
  Host *host_;
  Status *status_;
  IoOptions options_;
  std::map<std::string_view, base::DeviceClock> clocks_; // per topic: each must be consistent with itself
};

} // namespace bregma::driver
