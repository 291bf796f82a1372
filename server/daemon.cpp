#include "server/daemon.hpp"

#include <array>
#include <chrono>
#include <csignal>
#include <functional>
#include <optional>
#include <random>
#include <stdexcept>
#include <string_view>
#include <utility>

#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <spdlog/spdlog.h>

#include "idl/host_clock.hpp"
#include "idl/names.hpp"
#include "idl/peers.hpp"
#include "server/dds_topics.hpp"
#include "server/loops.hpp"
#include "server/other_daemons.hpp"
#include "server/process_alarms.hpp"
#include "server/runtime/ending.hpp"
#include "server/runtime/state_directory.hpp"
#include "server/runtime/state_lock.hpp"
#include "server/runtime/watchdog.hpp"
#include "server/session_recording.hpp"
#include "server/stages/health/stage.hpp"
#include "server/stages/session/stage.hpp"
#include "server/wiring.hpp"

namespace bregma::server {
namespace {

namespace asio = boost::asio;

constexpr std::chrono::seconds kListen{1};              // for another daemon, before the start
constexpr std::chrono::milliseconds kProcessWatch{200}; // interval of the watch for one
constexpr std::chrono::milliseconds kEndLimit{1500};    // from the signal to the end

spdlog::level::level_enum spdlog_level(LogLevel level) {
  constexpr spdlog::level::level_enum kLevels[] = {spdlog::level::debug, spdlog::level::info, spdlog::level::warn,
                                                   spdlog::level::err};
  return kLevels[static_cast<std::size_t>(level)];
}

runtime::StateLock lock_state(Config &config) {
  auto lock = runtime::StateLock::take(runtime::state_directory(config.stages.of<SessionParameters>().state_directory));
  if (!lock) {
    throw std::runtime_error(lock.error().message);
  }
  return std::move(*lock);
}

std::uint64_t random_number() {
  std::random_device device;
  return (std::uint64_t{device()} << 32U) | device() | 1U; // never 0: "not stated"
}

// Cyclone's messages come from its receive threads; the queue of our log takes them without waiting.
void log_dds(dds::Severity severity, std::string_view line) {
  constexpr LogLevel kLevels[] = {LogLevel::kInfo, LogLevel::kWarning, LogLevel::kError};
  spdlog::log(spdlog_level(kLevels[static_cast<std::size_t>(severity)]), "dds: {}", line);
}

} // namespace

class Daemon::Impl final : private Host {
public:
  Impl(const Config &config, std::string config_toml);
  void run();

private:
  [[nodiscard]] recording::RecorderStatus recorder() const noexcept override { return recorder_.status(); }
  void log(LogLevel level, const std::string &line) override { spdlog::log(spdlog_level(level), "{}", line); }
  void run_elsewhere(Work work, const std::function<void()> &job) override;
  [[nodiscard]] base::Result<std::optional<std::filesystem::path>> case_changed(const casefile::Case *loaded,
                                                                                std::int64_t utc_ns) override;
  [[nodiscard]] wire::BootIdentity boot_id() const override { return wire::boot_id(); }
  [[nodiscard]] std::uint64_t run_id() const override { return run_id_; }
  [[nodiscard]] AlarmEvents *conditions() noexcept override { return &alarms_.events; }
  void complete(wire::SystemHealth &health) override;

  void refuse_second_daemon();
  void record_truth();
  void watch_process(asio::steady_timer &timer);
  void feed(runtime::Watchdog &watchdog, asio::steady_timer &timer);

  Config config_;
  std::string config_toml_;
  runtime::SystemClock clock_;
  asio::io_context io_;
  runtime::StateLock state_lock_;
  asio::thread_pool workers_{1}; // one per kind of work
  asio::thread_pool loaders_{4}; // several, because a hung one must not delay the next
  asio::thread_pool savers_{1};
  asio::thread_pool scanner_workers_{1};
  std::uint64_t run_id_;
  dds::Participant participant_;
  OtherDaemons other_daemons_;
  ProcessAlarms alarms_;
  dds::Peers peers_;
  std::string other_wire_; // last logged value
  recording::Recorder recorder_;
  DdsTopics topics_;
  Wiring wiring_;
  Loops loops_;
};

Daemon::Daemon(const Config &config, std::string config_toml) {
  dds::set_log(log_dds);
  impl_ = std::make_unique<Impl>(config, std::move(config_toml));
}
Daemon::~Daemon() = default;
void Daemon::run() { impl_->run(); }

Daemon::Impl::Impl(const Config &config, std::string config_toml)
    : config_(config), config_toml_(std::move(config_toml)), state_lock_(lock_state(config_)), run_id_(random_number()),
      participant_(static_cast<std::uint32_t>(config.domain_id), dds::Role::kServer),
      other_daemons_(participant_, run_id_), peers_(participant_),
      recorder_({.interval = std::chrono::milliseconds(static_cast<int>(config.recorder.commit_ms))}),
      topics_(participant_, recorder_), wiring_(config_.stages, topics_, *this),
      loops_(wiring_.stages(), topics_, clock_) {}

void Daemon::Impl::run() {
  refuse_second_daemon();
  if (config_.realtime.lock_memory) {
    for (const std::string &sentence : runtime::lock_memory()) {
      spdlog::warn("memory: {}", sentence);
    }
  }
  if (const std::string advice = dds::send_buffer_advice(dds::send_buffer_bytes()); !advice.empty()) {
    spdlog::warn("network: {}", advice);
  }
  record_truth();
  asio::signal_set signals(io_, SIGINT, SIGTERM);
  signals.async_wait([this](const auto &error, int signal) {
    if (!error) {
      spdlog::info("{}: ending", signal == SIGTERM ? "SIGTERM" : "SIGINT");
      runtime::end_within(kEndLimit);
      io_.stop();
    }
  });
  loops_.start();

  runtime::Watchdog watchdog;
  for (auto &[name, heartbeat] : loops_.heartbeats()) {
    watchdog.watch(name, heartbeat);
  }
  asio::steady_timer watchdog_timer(io_);
  if (watchdog.interval()) {
    feed(watchdog, watchdog_timer);
  }
  asio::steady_timer process_timer(io_);
  watch_process(process_timer);
  watchdog.ready("serving DDS domain " + std::to_string(config_.domain_id));
  spdlog::info("bregmad {} ({}) serves DDS domain {}", BREGMA_VERSION, BREGMA_BUILD, config_.domain_id);
  io_.run();

  watchdog.stopping();
  loops_.stop();
  for (asio::thread_pool *pool : {&workers_, &loaders_, &savers_, &scanner_workers_}) {
    pool->join();
  }
  // The final message on the health topic, with the final counts of the loops.
  wiring_.find(HealthStage::kName)->step(moment_of(clock_));
  if (const auto closed = recorder_.close(); !closed) {
    spdlog::error("{}", closed.error().message);
  }
}

// Two daemons would both carry out every command. But a stray one must not keep an operating room down: a daemon that
// restores an open session starts in any case, and does not wait.
void Daemon::Impl::refuse_second_daemon() {
  const auto last = SnapshotFile(state_lock_.folder()).load();
  if (last && *last && (*last)->stage != bregma_wire_SESSION_IDLE) {
    return;
  }
  if (const std::string other = other_daemons_.listen(kListen); !other.empty()) {
    throw std::runtime_error("domain_id = " + std::to_string(config_.domain_id) + ": is served by another daemon (" +
                             other + "): stop it, or use another domain");
  }
}

void Daemon::Impl::run_elsewhere(Work work, const std::function<void()> &job) {
  asio::post(work == Work::kLoad      ? loaders_
             : work == Work::kSave    ? savers_
             : work == Work::kScanner ? scanner_workers_
                                      : workers_,
             job);
}

void Daemon::Impl::watch_process(asio::steady_timer &timer) {
  alarms_.update({.other_daemons = other_daemons_.heard(clock_.monotonic_ns()),
                  .refused_process = state_lock_.refused_process().value_or(""),
                  .loops = loops_.overruns()},
                 clock_.now_ns());
  timer.expires_after(kProcessWatch);
  timer.async_wait([this, &timer](const auto &error) {
    if (!error) {
      watch_process(timer);
    }
  });
}

// Records the simulator's truth on the recorder's thread, so that no stage can read it.
void Daemon::Impl::record_truth() {
  if (!config_.recorder.enabled || !config_.recorder.truth) {
    return;
  }
  auto reader = std::make_shared<dds::Reader<wire::SimulatedTruth>>(participant_);
  recorder_.set_poll([reader](recording::Channel &channel) {
    reader->take_each(
        [&](const wire::SimulatedTruth &truth, const auto &) { (void)channel.push(truth.time_ns, truth); });
  });
}

void Daemon::Impl::feed(runtime::Watchdog &watchdog, asio::steady_timer &timer) {
  timer.expires_after(*watchdog.interval());
  timer.async_wait([this, &watchdog, &timer](const auto &error) {
    if (!error) {
      for (const std::string &stuck : watchdog.feed()) {
        spdlog::error("the {} loop does not advance", stuck);
      }
      feed(watchdog, timer);
    }
  });
}

base::Result<std::optional<std::filesystem::path>> Daemon::Impl::case_changed(const casefile::Case *loaded,
                                                                              std::int64_t utc_ns) {
  if (!config_.recorder.enabled) {
    return std::nullopt;
  }
  const std::filesystem::path file = loaded != nullptr ? new_session_file(*loaded, utc_ns) : std::filesystem::path();
  const auto done = loaded != nullptr
                        ? recorder_.open(file, attachments_of(*loaded, config_toml_), meta_of(*loaded, utc_ns))
                        : recorder_.close();
  if (!done) {
    return tl::unexpected(done.error());
  }
  return file;
}

// Adds the process, the loops and participants with another wire version; logs changes of the latter.
void Daemon::Impl::complete(wire::SystemHealth &health) {
  health.run_id = run_id_;
  health.process_id = static_cast<std::uint32_t>(::getpid());
  char host[sizeof(wire::Name)] = {};
  if (::gethostname(host, sizeof host - 1) == 0) { // a longer name is cut
    (void)wire::set_name(health.host, host);
  }
  loops_.add_health(health);
  peers_.update();
  const auto others = peers_.of_another_wire();
  health.other_wire = static_cast<std::uint32_t>(others.size());
  health.ill_typed_samples = dds::ill_typed_samples();
  wire::set_text(health.mismatches, participant_.mismatches().text());
  if (std::string text = dds::other_wire_text(others); text != other_wire_) {
    spdlog::warn("wire: {}", text.empty() ? "no participant of another wire is left" : text);
    other_wire_ = std::move(text);
  }
}

} // namespace bregma::server
