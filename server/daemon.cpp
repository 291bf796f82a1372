#include "server/daemon.hpp"

#include <chrono>
#include <csignal>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <spdlog/spdlog.h>

#include "server/loops.hpp"
#include "server/runtime/process_memory.hpp"
#include "server/runtime/watchdog.hpp"
#include "server/session_recording.hpp"

namespace bregma::server {
namespace {

namespace asio = boost::asio;
using namespace std::chrono_literals;

constexpr auto kPollInterval = 5ms; // of commands and of what the loops say

} // namespace

class Daemon::Impl final : private ControlSink {
public:
  Impl(const Config &config, std::string config_toml);
  void run();

private:
  void publish(const wire::CommandReply &reply) override;
  void publish(const wire::Alarm &alarm) override;
  void publish(const wire::CapturedPoint &point) override { captures_(point, clock_.now_ns()); }
  void log(const std::string &line) override { spdlog::info("{}", line); }
  void case_changed(const casefile::Case *loaded) override;

  void every(asio::steady_timer &timer, std::chrono::nanoseconds interval, std::function<void()> work);
  void poll();
  void publish_health();

  Config config_;
  std::string config_toml_;
  runtime::SystemClock clock_;
  std::int64_t started_ns_ = clock_.now_ns();
  asio::io_context io_;
  asio::thread_pool workers_{1}; // pivot calibrations
  dds::Participant participant_;
  recording::Recorder recorder_;
  recording::Channel &channel_;
  Publisher<wire::CommandReply> replies_;
  Publisher<wire::Alarm> alarms_;
  Publisher<wire::CapturedPoint> captures_;
  Publisher<wire::SystemHealth> health_;
  dds::Reader<wire::Command> commands_;
  std::string case_folder_;
  Engine engine_;
  Loops loops_;
};

Daemon::Daemon(const Config &config, std::string config_toml)
    : impl_(std::make_unique<Impl>(config, std::move(config_toml))) {}
Daemon::~Daemon() = default;
void Daemon::run() { impl_->run(); }

Daemon::Impl::Impl(const Config &config, std::string config_toml)
    : config_(config), config_toml_(std::move(config_toml)), participant_(static_cast<std::uint32_t>(config.domain_id)),
      recorder_({.interval = std::chrono::milliseconds(static_cast<int>(config.recorder.commit_ms))}),
      channel_(recorder_.channel("control")), replies_(participant_, channel_), alarms_(participant_, channel_),
      captures_(participant_, channel_), health_(participant_, channel_), commands_(participant_),
      engine_(config, *this, [this](std::function<void()> job) { asio::post(workers_, std::move(job)); }),
      loops_(config, engine_, participant_, recorder_, clock_) {}

void Daemon::Impl::run() {
  if (config_.realtime.lock_memory) {
    for (const std::string &sentence : runtime::lock_memory()) {
      spdlog::warn("memory: {}", sentence);
    }
  }
  if (config_.recorder.enabled && config_.recorder.truth) {
    // The simulator's truth goes from the wire to the file on the recorder's own thread: no pipeline can see it.
    auto reader = std::make_shared<dds::Reader<wire::SimulatedTruth>>(participant_);
    recorder_.set_poll([reader](recording::Channel &channel) {
      reader->take_each(
          [&](const wire::SimulatedTruth &truth, const auto &) { (void)channel.push(truth.time_ns, truth); });
    });
  }
  asio::signal_set signals(io_, SIGINT, SIGTERM);
  signals.async_wait([this](const auto &error, int signal) {
    if (!error) {
      spdlog::info("{}: ending", signal == SIGTERM ? "SIGTERM" : "SIGINT");
      io_.stop();
    }
  });
  engine_.session().restore(clock_.now_ns());
  loops_.start();

  asio::steady_timer poll_timer(io_);
  asio::steady_timer health_timer(io_);
  asio::steady_timer watchdog_timer(io_);
  every(poll_timer, kPollInterval, [this] { poll(); });
  every(health_timer, std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / config_.health.rate_hz)),
        [this] { publish_health(); });
  runtime::Watchdog watchdog;
  for (auto &[name, heartbeat] : loops_.heartbeats()) {
    watchdog.watch(name, heartbeat);
  }
  if (watchdog.interval()) {
    every(watchdog_timer, *watchdog.interval(), [&watchdog] {
      for (const std::string &stuck : watchdog.feed()) {
        spdlog::error("the {} loop stands still", stuck);
      }
    });
  }
  watchdog.ready("serving DDS domain " + std::to_string(config_.domain_id));
  spdlog::info("bregmad serves DDS domain {}", config_.domain_id);
  io_.run();

  watchdog.stopping();
  loops_.stop();
  workers_.join();
  publish_health();
  if (const auto closed = recorder_.close(); !closed) {
    spdlog::error("{}", closed.error().message);
  }
}

void Daemon::Impl::every(asio::steady_timer &timer, std::chrono::nanoseconds interval, std::function<void()> work) {
  timer.expires_after(interval);
  timer.async_wait([this, &timer, interval, work = std::move(work)](const auto &error) mutable {
    if (!error) {
      work();
      every(timer, interval, std::move(work));
    }
  });
}

void Daemon::Impl::poll() {
  commands_.take_each([this](const wire::Command &command, const auto &) {
    const std::int64_t now_ns = clock_.now_ns();
    (void)channel_.push(now_ns, command);
    engine_.session().handle(command, now_ns);
  });
  engine_.poll(clock_.now_ns());
}

void Daemon::Impl::publish(const wire::CommandReply &reply) {
  spdlog::info("{} {}: {}", wire::view(reply.client), reply.id, reply.text);
  replies_(reply, clock_.now_ns());
}

void Daemon::Impl::publish(const wire::Alarm &alarm) {
  const char *what = alarm.state == bregma_wire_ALARM_RAISED         ? "raised"
                     : alarm.state == bregma_wire_ALARM_ACKNOWLEDGED ? "acknowledged"
                                                                     : "cleared";
  spdlog::warn("alarm {}: {} {}: {}", what, wire::view(alarm.kind), wire::view(alarm.subject), alarm.text);
  alarms_(alarm, clock_.now_ns());
}

void Daemon::Impl::case_changed(const casefile::Case *loaded) {
  case_folder_ = loaded != nullptr ? loaded->folder.string() : std::string();
  if (!config_.recorder.enabled) {
    return;
  }
  const std::int64_t now_ns = clock_.now_ns();
  const std::filesystem::path file = loaded != nullptr ? new_session_file(*loaded, now_ns) : std::filesystem::path();
  const auto done = loaded != nullptr
                        ? recorder_.open(file, attachments_of(*loaded, config_toml_), meta_of(*loaded, now_ns))
                        : recorder_.close();
  // The session is in the middle of the command that has brought the case: it hears of the file when it is done.
  asio::post(io_, [this, file, done, now_ns] {
    if (!done) {
      engine_.session().on(not_recording(done.error().message, now_ns), now_ns);
    } else {
      engine_.session().recording_to(file);
    }
  });
}

void Daemon::Impl::publish_health() {
  wire::SystemHealth health{};
  const std::int64_t now_ns = clock_.now_ns();
  (void)wire::set_name(health.daemon, "bregmad");
  health.time_ns = now_ns;
  health.started_time_ns = started_ns_;
  health.session = engine_.session().state();
  wire::set_text(health.case_folder, case_folder_);
  engine_.add_devices(health);
  loops_.add_health(health);
  const recording::RecorderStatus recorder = recorder_.status();
  health.recorded = recorder.recorded;
  health.record_dropped = recorder.dropped + engine_.dropped_messages();
  health.recorder_failing = recorder.failing;
  health.resident_bytes = runtime::resident_bytes();
  health_(health, now_ns);
}

} // namespace bregma::server
