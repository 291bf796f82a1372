#include "drivers/frame/loop.hpp"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <utility>

namespace bregma::driver {
namespace {

std::string seconds_text(std::int64_t duration_ns) {
  char text[32];
  (void)std::snprintf(text, sizeof text, "%.1f s", static_cast<double>(duration_ns) * 1e-9);
  return text;
}

// Converts an exception of a device to an error.
template <class Call> auto guarded(Call &&call) -> decltype(call()) {
  try {
    return call();
  } catch (const std::exception &error) {
    return retry_later(error.what());
  }
}

} // namespace

DriverLoop::DriverLoop(Device &device, Io &io, Status &status, Log log, const LoopOptions &options)
    : device_(&device), io_(&io), status_(&status), log_(std::move(log)), options_(options),
      backoff_(options.backoff, options.backoff_seed) {}

Ending DriverLoop::run() {
  Ending ending = Ending::kDone;
  while (!io_->stopping()) {
    Outcome<Progress> outcome = Progress::kContinue;
    if (const auto connected = connect(); connected) {
      outcome = read_until_it_ends();
    } else {
      outcome = tl::unexpected(connected.error());
    }
    disconnect();
    if (outcome || io_->stopping()) {
      break;
    }
    if (outcome.error().permanent) {
      status_->update([&](StatusValues &values) {
        ++values.failures;
        values.failure = outcome.error().message;
      });
      log_(LogLevel::kError, outcome.error().message);
      ending = Ending::kFailed;
      break;
    }
    const std::int64_t delay_ns = backoff_.next_ns();
    report_failure(outcome.error(), delay_ns);
    enter(State::kWaiting);
    (void)io_->wait_until(io_->now_ns() + delay_ns);
  }
  enter(State::kStopped);
  return ending;
}

Outcome<void> DriverLoop::connect() {
  enter(State::kConnecting);
  io_->start_connection();
  auto outcome = guarded([this] { return device_->connect(*io_); });
  if (outcome) {
    connected_ns_ = io_->now_ns();
    const bool again = status_->values().connections > 0;
    status_->update([this](StatusValues &values) {
      ++values.connections;
      values.last_sample_ns = connected_ns_;
    });
    enter(State::kConnected);
    log_(LogLevel::kInfo, again ? "connected again" : "connected");
  }
  return outcome;
}

Outcome<Progress> DriverLoop::read_once() {
  auto outcome = guarded([this] { return device_->read(*io_); });
  const std::int64_t now_ns = io_->now_ns();
  std::int64_t silent_ns = 0;
  status_->update([&](StatusValues &values) {
    values.last_return_ns = now_ns;
    silent_ns = now_ns - values.last_sample_ns;
  });
  if (outcome && options_.silence_ns > 0 && silent_ns > options_.silence_ns) {
    return retry_later("no sample for " + seconds_text(silent_ns));
  }
  return outcome;
}

Outcome<Progress> DriverLoop::read_until_it_ends() {
  Outcome<Progress> outcome = Progress::kContinue;
  while (outcome && *outcome == Progress::kContinue && !io_->stopping()) {
    outcome = read_once();
  }
  // A connection that repeatedly breaks at once must not reset the delay.
  if (io_->now_ns() - connected_ns_ > options_.backoff.max_ns) {
    backoff_.reset();
  }
  return outcome;
}

void DriverLoop::disconnect() {
  device_->disconnect();
  status_->update([this](StatusValues &values) { values.last_return_ns = io_->now_ns(); });
}

void DriverLoop::enter(State state) {
  status_->update([&](StatusValues &values) {
    values.state = state;
    values.last_return_ns = io_->now_ns();
  });
}

void DriverLoop::report_failure(const DeviceError &error, std::int64_t delay_ns) {
  status_->update([&](StatusValues &values) {
    ++values.failures;
    values.failure = error.message;
  });
  log_(LogLevel::kWarning, error.message + "; next attempt in " + seconds_text(delay_ns));
}

} // namespace bregma::driver
