#include "drivers/frame/supervisor.hpp"

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <future>
#include <system_error>
#include <utility>

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <unistd.h>

namespace bregma::driver {
namespace {

constexpr int kTick_ms = 100; // a change of state is published within this time

sigset_t ending_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  return set;
}

class Event {
public:
  Event() : descriptor_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (descriptor_ < 0) {
      throw std::system_error(errno, std::generic_category(), "cannot make an event");
    }
  }
  ~Event() { close(descriptor_); }
  Event(const Event &) = delete;
  Event &operator=(const Event &) = delete;
  [[nodiscard]] int descriptor() const { return descriptor_; }
  void signal() const { (void)eventfd_write(descriptor_, 1); }

private:
  int descriptor_;
};

// Also if the loop ends with an exception, which the future passes to the caller.
struct EndNotifier {
  const Event &ended;
  ~EndNotifier() { ended.signal(); }
};

// Work of the watching thread per tick.
class Reporter {
public:
  Reporter(const Status &status, Bus &bus, const Log &log, const SupervisorOptions &options, std::int64_t now_ns)
      : status_(&status), bus_(&bus), log_(&log), options_(&options), started_ns_(now_ns) {}

  void tick(std::int64_t now_ns) {
    const StatusValues values = status_->values();
    report_blocked(values, now_ns);
    if (values.state == published_.state && now_ns - published_ns_ < options_->health_period_ns) {
      return;
    }
    if (const auto dropped = dropped_text(published_, values)) {
      (*log_)(LogLevel::kWarning, *dropped);
    }
    const wire::DriverHealth sample = to_wire(values, options_->device, now_ns, started_ns_);
    if (!bus_->write(wire::Topic<wire::DriverHealth>::kName, &sample)) {
      (*log_)(LogLevel::kWarning, "DDS did not take the driver's health");
    }
    published_ = values;
    published_ns_ = now_ns;
  }

private:
  void report_blocked(const StatusValues &values, std::int64_t now_ns) {
    const bool blocked = values.state != State::kWaiting && values.last_return_ns > 0 &&
                         now_ns - values.last_return_ns > options_->blocked_ns;
    if (blocked != blocked_) {
      blocked_ = blocked;
      (*log_)(LogLevel::kWarning, blocked ? "the device's code does not return" : "the device's code returns again");
    }
  }

  const Status *status_;
  Bus *bus_;
  const Log *log_;
  const SupervisorOptions *options_;
  std::int64_t started_ns_;
  std::int64_t published_ns_ = 0;
  StatusValues published_;
  bool blocked_ = false;
};

} // namespace

Signals::Signals() {
  const sigset_t set = ending_signals();
  if (const int error = pthread_sigmask(SIG_BLOCK, &set, nullptr); error != 0) {
    throw std::system_error(error, std::generic_category(), "cannot block signals");
  }
  descriptor_ = signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
  if (descriptor_ < 0) {
    throw std::system_error(errno, std::generic_category(), "cannot wait for signals");
  }
}

Signals::~Signals() { close(descriptor_); }

bool Signals::taken() const {
  signalfd_siginfo info{};
  return read(descriptor_, &info, sizeof info) == static_cast<ssize_t>(sizeof info);
}

int supervise(DriverLoop &loop, const Signals &signals, SystemHost &host, const Status &status, Bus &bus,
              const Log &log, const SupervisorOptions &options) {
  const Event ended; // outlives the thread that signals it
  auto ending = std::async(std::launch::async, [&loop, &ended] {
    const EndNotifier notifier{ended};
    return loop.run();
  });
  Reporter reporter(status, bus, log, options, host.now_ns());
  std::int64_t stop_ns = 0; // time of the signal
  for (;;) {
    reporter.tick(host.now_ns());
    pollfd events[] = {{ended.descriptor(), POLLIN, 0}, {signals.descriptor(), POLLIN, 0}};
    (void)poll(events, 2, kTick_ms);
    if ((events[0].revents & POLLIN) != 0) {
      break;
    }
    if (signals.taken() && stop_ns == 0) {
      stop_ns = host.now_ns();
      log(LogLevel::kInfo, "ending");
      host.stop();
    }
    if (stop_ns != 0 && host.now_ns() - stop_ns > options.grace_ns) {
      log(LogLevel::kError, "the device's code does not return; ended without disconnecting it");
      std::_Exit(kExitBlocked);
    }
  }
  reporter.tick(host.now_ns());
  return ending.get() == Ending::kDone ? kExitDone : kExitFailed;
}

} // namespace bregma::driver
