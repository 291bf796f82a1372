// Input check of one stream. Every sample of TrackerFrame, RobotState, RobotMotionState, RangeSample or ForceSample
// passes here once. It is either accepted, with its time of exposure on the host's clock, or rejected and counted per
// reason. Accepted samples have finite values, valid rotations, terminated names, counts in range and increasing times.
//
//   InputGuard<wire::TrackerFrame> guard(names, options);
//   guard.set_host(host_clock);
//   reader.take_each([&](const wire::TrackerFrame &frame, const dds::SampleInfo &info) {
//     if (const auto verdict = guard.check(frame, info.writer, clock.now_ns()); verdict.accepted) ...
//   });
//
// A flood of samples cannot delay other devices: a check takes about 1 µs, and the topic's history depth bounds the
// number of waiting samples per device.
//
// Threads: one, the reader of the stream. Other threads get copies of health() through a runtime::LatestValue.
// No allocation after construction, no exceptions.
#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <type_traits>

#include "idl/names.hpp"
#include "server/inputs/device_monitor.hpp"
#include "server/inputs/unknown_names.hpp"

namespace bregma::inputs {

template <class Sample> struct KindOf;
template <> struct KindOf<wire::TrackerFrame> { static constexpr auto kKind = bregma_wire_DEVICE_TRACKER; };
template <> struct KindOf<wire::RobotState> { static constexpr auto kKind = bregma_wire_DEVICE_ROBOT; };
template <> struct KindOf<wire::RobotMotionState> { static constexpr auto kKind = bregma_wire_DEVICE_ROBOT; };
template <> struct KindOf<wire::RangeSample> { static constexpr auto kKind = bregma_wire_DEVICE_RANGE; };
template <> struct KindOf<wire::ForceSample> { static constexpr auto kKind = bregma_wire_DEVICE_FORCE; };

// The stream's part of wire::SystemHealth.
struct StreamHealth {
  std::uint32_t device_count = 0;
  wire::DeviceHealth devices[bregma_wire_MAX_DEVICES] = {};
  std::uint64_t unknown_device_samples = 0;
  UnknownNames unknown_devices; // not configured
  UnknownNames unknown_tools;   // not in the case; ignored in accepted frames
};

// Appends the stream's devices and adds its unknown samples. Devices beyond MAX_DEVICES are omitted.
// health: a wire::SystemHealth, or the StreamHealth of several streams.
template <class Health> void add_to(Health &health, const StreamHealth &stream) noexcept {
  for (std::uint32_t i = 0; i < stream.device_count && health.device_count < bregma_wire_MAX_DEVICES; ++i) {
    health.devices[health.device_count++] = stream.devices[i];
  }
  health.unknown_device_samples += stream.unknown_device_samples;
  if constexpr (std::is_same_v<Health, StreamHealth>) {
    health.unknown_devices.add(stream.unknown_devices);
    health.unknown_tools.add(stream.unknown_tools);
  }
}

template <class Sample> class InputGuard {
public:
  // devices: names of at most wire::kNameLength bytes (longer ones throw std::invalid_argument), at most MAX_DEVICES.
  InputGuard(std::span<const std::string> devices, DeviceOptions options);

  void set_tools(const KnownTools &tools) noexcept { tools_ = tools; }

  // This host's clocks, before check(): they may step between two samples.
  void set_host(const HostClock &host) noexcept { host_ = host; }

  // now_ns: arrival, steady UTC.
  [[nodiscard]] Verdict check(const Sample &sample, std::uint64_t writer, std::int64_t now_ns) noexcept;

  // count: ReaderStatus::writers_alive. With 0 every device of the stream is lost at once.
  void set_writers_alive(std::uint32_t count) noexcept;

  [[nodiscard]] const std::deque<DeviceMonitor> &devices() const noexcept { return devices_; }
  [[nodiscard]] std::uint64_t unknown_device_samples() const noexcept { return unknown_; }
  [[nodiscard]] StreamHealth health(std::int64_t now_ns) const noexcept;

private:
  std::deque<DeviceMonitor> devices_; // a deque, because a histogram of atomics cannot be moved
  KnownTools tools_;
  HostClock host_;
  std::uint64_t unknown_ = 0;
  UnknownNames unknown_devices_;
  UnknownNames unknown_tools_;
};

extern template class InputGuard<wire::TrackerFrame>;
extern template class InputGuard<wire::RobotState>;
extern template class InputGuard<wire::RobotMotionState>;
extern template class InputGuard<wire::RangeSample>;
extern template class InputGuard<wire::ForceSample>;

} // namespace bregma::inputs
