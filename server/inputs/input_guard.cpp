#include "server/inputs/input_guard.hpp"

#include <algorithm>
#include <iterator>
#include <stdexcept>

namespace bregma::inputs {

template <class Sample> InputGuard<Sample>::InputGuard(std::span<const std::string> devices, DeviceOptions options) {
  if (options.deadline_ns == 0) {
    options.deadline_ns = wire::Topic<Sample>::kQos.deadline_ns;
  }
  if (devices.size() > bregma_wire_MAX_DEVICES) {
    throw std::invalid_argument("more than " + std::to_string(bregma_wire_MAX_DEVICES) + " devices for topic " +
                                wire::Topic<Sample>::kName);
  }
  for (const std::string &device : devices) {
    wire::Name name{};
    if (device.empty() || !wire::set_name(name, device)) {
      throw std::invalid_argument("device name '" + device + "': must have 1 to " + std::to_string(wire::kNameLength) +
                                  " bytes");
    }
    devices_.emplace_back(name, KindOf<Sample>::kKind, options);
  }
}

template <class Sample>
Verdict InputGuard<Sample>::check(const Sample &sample, std::uint64_t writer, std::int64_t now_ns) noexcept {
  const std::string_view name = wire::view(sample.device);
  for (std::size_t i = 0; i < devices_.size(); ++i) {
    if (wire::view(devices_[i].name()) == name) {
      SampleHeader header{sample.frame,
                          sample.device_time_ns,
                          sample.period_ns,
                          {.boot_ns = sample.sent_boot_ns,
                           .wall_ns = sample.sent_time_ns,
                           .wall_error_ns = sample.sent_clock_error_ns}};
      std::copy(std::begin(sample.boot_id), std::end(sample.boot_id), header.write.boot_id.begin());
      Verdict verdict = devices_[i].check(header, check_payload(sample, tools_), writer, now_ns, host_);
      verdict.device = static_cast<int>(i);
      if constexpr (std::is_same_v<Sample, wire::TrackerFrame>) {
        for (std::uint32_t tool = 0; verdict.accepted && tool < sample.tool_count; ++tool) {
          if (!tools_.contains(wire::view(sample.tools[tool].tool))) {
            unknown_tools_.add(sample.tools[tool].tool, now_ns);
          }
        }
      }
      return verdict;
    }
  }
  ++unknown_;
  unknown_devices_.add(sample.device, now_ns);
  return {.accepted = false, .reason = bregma_wire_REJECT_UNKNOWN_DEVICE};
}

template <class Sample> void InputGuard<Sample>::set_writers_alive(std::uint32_t count) noexcept {
  if (count == 0) {
    for (DeviceMonitor &device : devices_) {
      device.writers_gone();
    }
  }
}

template <class Sample> StreamHealth InputGuard<Sample>::health(std::int64_t now_ns) const noexcept {
  StreamHealth out;
  for (const DeviceMonitor &device : devices_) {
    out.devices[out.device_count++] = device.health(now_ns);
  }
  out.unknown_device_samples = unknown_;
  out.unknown_devices = unknown_devices_;
  out.unknown_tools = unknown_tools_;
  return out;
}

template class InputGuard<wire::TrackerFrame>;
template class InputGuard<wire::RobotState>;
template class InputGuard<wire::RobotMotionState>;
template class InputGuard<wire::RangeSample>;
template class InputGuard<wire::ForceSample>;

} // namespace bregma::inputs
