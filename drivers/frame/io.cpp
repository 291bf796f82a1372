#include "drivers/frame/io.hpp"

#include <utility>

namespace bregma::driver {
namespace {

constexpr double kMillisecond = 1e6; // ns

} // namespace

Io::Io(Bus &bus, Host &host, Status &status, IoOptions options)
    : bus_(&bus), host_(&host), status_(&status), options_(std::move(options)) {}

void Io::start_connection() { clocks_.clear(); }

void Io::skipped(std::uint64_t count, std::string_view reason) {
  status_->update([&](StatusValues &values) {
    values.skipped += count;
    values.skip_reason = reason;
  });
}

bool Io::prepare(std::string_view topic, wire::Name &device, std::int64_t &device_time_ns, std::int64_t period_ns,
                 std::int64_t arrival_ns) {
  if (device[0] == '\0') {
    (void)wire::set_name(device, options_.device); // its length was checked with the settings
  }
  if (!options_.map_device_time) {
    return true;
  }
  const auto [found, is_new] = clocks_.try_emplace(
      topic, base::DeviceClock(base::DeviceClockOptions{.minimum_latency_ns = options_.minimum_latency_ns}));
  base::DeviceClock &clock = found->second;
  const auto verdict = clock.observe(device_time_ns, arrival_ns != 0 ? arrival_ns : host_->now_ns(), period_ns);
  const bool resynced = verdict == base::TimeVerdict::kResynced;
  if (verdict != base::TimeVerdict::kInStep && !resynced) {
    status_->update([](StatusValues &values) { ++values.out_of_step; });
    return false;
  }
  const std::int64_t mapped_ns = clock.to_host_ns(device_time_ns);
  status_->update([&](StatusValues &values) {
    values.clock_offset_ms = static_cast<double>(mapped_ns - device_time_ns) / kMillisecond;
    values.clock_drift_ppm = clock.drift_ppm();
    values.clock_resyncs += resynced ? 1 : 0;
  });
  device_time_ns = mapped_ns;
  return true;
}

bool Io::write(std::string_view topic, const void *sample) {
  const bool written = bus_->write(topic, sample);
  status_->update([&](StatusValues &values) {
    ++(written ? values.published : values.refused);
    values.last_sample_ns = host_->now_ns();
  });
  return written;
}

} // namespace bregma::driver
