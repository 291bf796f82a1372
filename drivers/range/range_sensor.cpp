#include "drivers/range/range_sensor.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <variant>

namespace bregma::range {
namespace {

using namespace std::chrono_literals;

constexpr std::int64_t kQuestion_ns = 1'000'000'000; // between questions for the identity
constexpr std::int64_t kIdentity_ns = 3'000'000'000; // until one must have been answered

} // namespace

Measured measured(const PowerCurve &curve, const Identity &sensor, std::uint32_t counts) {
  const double step_V = 1e-3 * sensor.full_scale_mV / static_cast<double>((1U << sensor.bits) - 1U);
  const double voltage_V = counts * step_V;
  const double distance_mm = curve.law.distance_mm(voltage_V);
  if (!(distance_mm <= curve.far_mm)) { // nor without a voltage
    return {.status = bregma_wire_RANGE_TOO_FAR};
  }
  if (distance_mm < curve.near_mm) {
    return {.status = bregma_wire_RANGE_TOO_NEAR};
  }
  const double slope_mm_V = -curve.law.exponent * distance_mm / voltage_V;
  // A step of the ADC is a uniform error.
  const double voltage_sigma_V = std::hypot(1e-3 * curve.noise_mV, step_V / std::sqrt(12.0));
  return {bregma_wire_RANGE_VALID, distance_mm, std::hypot(slope_mm_V * voltage_sigma_V, curve.sigma_mm)};
}

void RangeSensor::declare(base::ParameterSet &parameters) {
  parameters.string("address", &address_, "Of the sensor: serial:///DEVICE?baud=N or tcp://HOST:PORT")
      .string("serial_number", &serial_number_, "Of the sensor that the curve belongs to; others are not used")
      .number("period_ms", &period_ms_, "ms", 0.2, 1000.0, "Time between readings")
      .number("curve.scale_mm", &curve_.law.scale_mm, "mm", 1.0, 1e5, "Distance at one volt")
      .number("curve.exponent", &curve_.law.exponent, "", -5.0, -0.1, "Of the voltage")
      .number("curve.near_mm", &curve_.near_mm, "mm", 0.0, 1e4, "Nearer readings are RANGE_TOO_NEAR")
      .number("curve.far_mm", &curve_.far_mm, "mm", 1.0, 1e4, "Farther readings are RANGE_TOO_FAR")
      .number("curve.noise_mV", &curve_.noise_mV, "mV", 0.0, 1000.0, "Of a reading, 1 sigma")
      .number("curve.sigma_mm", &curve_.sigma_mm, "mm", 0.0, 100.0, "Of the curve itself, 1 sigma");
}

base::Result<void> RangeSensor::prepare(const driver::Settings & /*settings*/) {
  if (curve_.near_mm >= curve_.far_mm) {
    return base::failure("curve.near_mm = " + std::to_string(curve_.near_mm) + ": must be below curve.far_mm");
  }
  return driver::check_address("address", address_);
}

driver::Outcome<void> RangeSensor::connect(driver::Io &io) {
  lines_.reset();
  sensor_.reset();
  last_.reset();
  garbled_ = 0;
  if (auto opened = stream_.open(address_, io); !opened) {
    return opened;
  }
  // What waited on the line before is old, and its end may be lost.
  if (const auto old = stream_.read(io, 1ms); !old) {
    return tl::unexpected(old.error());
  }
  identified_ns_ = io.now_ns();
  return ask(io);
}

driver::Outcome<void> RangeSensor::ask(driver::Io &io) {
  asked_ns_ = io.now_ns();
  return stream_.write(identity_question(), io);
}

driver::Outcome<driver::Progress> RangeSensor::read(driver::Io &io) {
  const auto bytes = stream_.read(io, 100ms);
  if (!bytes) {
    return tl::unexpected(bytes.error());
  }
  if (auto taken = take_lines(*bytes, io); !taken) {
    return tl::unexpected(taken.error());
  }
  const std::int64_t now_ns = io.now_ns();
  if (now_ns - identified_ns_ > kIdentity_ns) {
    return driver::retry_later(address_ + ": the sensor does not state its identity");
  }
  if (now_ns - asked_ns_ > kQuestion_ns) { // it may have been swapped without an interruption of the line
    if (auto asked = ask(io); !asked) {
      return tl::unexpected(asked.error());
    }
  }
  return driver::Progress::kContinue;
}

driver::Outcome<void> RangeSensor::take_lines(std::string_view bytes, driver::Io &io) {
  driver::Outcome<void> outcome;
  const std::size_t too_long = lines_.take(bytes, [&](std::string_view line) {
    if (!outcome) {
      return;
    }
    const auto message = parse(line);
    if (!message) {
      ++garbled_;
      io.skipped(1, message.error());
    } else if (const auto *identity = std::get_if<Identity>(&*message)) {
      outcome = check_identity(*identity, io);
    } else if (sensor_) {
      take_reading(std::get<Reading>(*message), io);
    } // a reading of a sensor that is not known yet is no measurement
  });
  if (too_long > 0) {
    garbled_ += too_long;
    io.skipped(too_long, "line too long");
  }
  return outcome;
}

driver::Outcome<void> RangeSensor::check_identity(const Identity &identity, const driver::Io &io) {
  if (identity.serial != serial_number_) {
    sensor_.reset();
    const std::string found = address_ + ": sensor " + identity.model + " " + identity.serial;
    return driver::retry_later(
        serial_number_.empty()
            ? found + " is not used before a person has checked its curve: set serial_number = " + identity.serial
            : found + " instead of " + serial_number_ +
                  " is not used: plug in the right one, or set serial_number and its curve");
  }
  if (sensor_ && identity != *sensor_) {
    return driver::retry_later(address_ + ": sensor " + identity.serial + " has changed its scale");
  }
  sensor_ = identity;
  identified_ns_ = io.now_ns();
  return {};
}

void RangeSensor::take_reading(const Reading &reading, driver::Io &io) {
  if (last_ && reading.counter <= last_->counter) {
    io.skipped(1, "the sensor's counter went back: it restarted, or is another one");
    sensor_.reset(); // until it has stated its identity again
    last_.reset();
    asked_ns_ = 0;
    return;
  }
  if (last_) {
    fill_gap(reading, io);
  }
  garbled_ = 0;
  last_ = reading;
  publish(reading.counter, reading.time_us, reading.counts ? measured(curve_, *sensor_, *reading.counts) : Measured{},
          io);
}

// The lost readings between the last one and the next. Damaged lines come first: nothing tells their order.
void RangeSensor::fill_gap(const Reading &next, driver::Io &io) {
  const std::uint64_t lost = next.counter - last_->counter - 1;
  if (lost > garbled_) {
    io.skipped(lost - garbled_, "readings are missing");
  }
  if (lost == 0 || lost > kMaxFilled || next.time_us <= last_->time_us) {
    return;
  }
  const std::uint64_t step_us = (next.time_us - last_->time_us) / (lost + 1);
  for (std::uint64_t i = 1; i <= lost; ++i) {
    const auto status = i <= garbled_ ? bregma_wire_RANGE_GARBLED : bregma_wire_RANGE_MISSING;
    publish(last_->counter + i, last_->time_us + i * step_us, Measured{.status = status}, io);
  }
}

void RangeSensor::publish(std::uint64_t counter, std::uint64_t time_us, const Measured &value, driver::Io &io) const {
  wire::RangeSample sample{};
  sample.frame = counter;
  sample.device_time_ns = static_cast<std::int64_t>(time_us) * 1'000;
  sample.period_ns = std::llround(period_ms_ * 1e6);
  sample.status = value.status;
  sample.range_mm = value.range_mm;
  sample.sigma_mm = value.sigma_mm;
  (void)io.publish(sample);
}

} // namespace bregma::range
