#include "server/daemon.hpp"

#include <array>
#include <chrono>
#include <csignal>
#include <functional>
#include <optional>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <spdlog/spdlog.h>

#include "idl/boot_clock.hpp"
#include "idl/peers.hpp"
#include "server/dds_topics.hpp"
#include "server/loops.hpp"
#include "server/runtime/watchdog.hpp"
#include "server/session_recording.hpp"
#include "server/stages/health/stage.hpp"
#include "server/wiring.hpp"

namespace bregma::server {
namespace {

namespace asio = boost::asio;

spdlog::level::level_enum spdlog_level(LogLevel level) {
  constexpr spdlog::level::level_enum kLevels[] = {spdlog::level::debug, spdlog::level::info, spdlog::level::warn,
                                                   spdlog::level::err};
  return kLevels[static_cast<std::size_t>(level)];
}

} // namespace

class Daemon::Impl final : private Host {
public:
  Impl(const Config &config, std::string config_toml);
  void run();

private:
  [[nodiscard]] recording::RecorderStatus recorder() const noexcept override { return recorder_.status(); }
  [[nodiscard]] std::uint64_t overruns() const noexcept override { return loops_.overruns(); }
  void log(LogLevel level, const std::string &line) override { spdlog::log(spdlog_level(level), "{}", line); }
  void run_elsewhere(const std::function<void()> &job) override { asio::post(workers_, job); }
  [[nodiscard]] base::Result<std::optional<std::filesystem::path>> case_changed(const casefile::Case *loaded,
                                                                                std::int64_t utc_ns) override;
  [[nodiscard]] std::array<std::uint8_t, 16> boot_id() const override { return wire::boot_id(); }
  void complete(wire::SystemHealth &health) override;

  void record_truth();
  void feed(runtime::Watchdog &watchdog, asio::steady_timer &timer);

  Config config_;
  std::string config_toml_;
  runtime::SystemClock clock_;
  asio::io_context io_;
  asio::thread_pool workers_{1}; // pivot calibrations
  dds::Participant participant_;
  dds::Peers peers_;
  std::string other_wire_; // last logged value
  recording::Recorder recorder_;
  DdsTopics topics_;
  Wiring wiring_;
  Loops loops_;
};

Daemon::Daemon(const Config &config, std::string config_toml)
    : impl_(std::make_unique<Impl>(config, std::move(config_toml))) {}
Daemon::~Daemon() = default;
void Daemon::run() { impl_->run(); }

Daemon::Impl::Impl(const Config &config, std::string config_toml)
    : config_(config), config_toml_(std::move(config_toml)), participant_(static_cast<std::uint32_t>(config.domain_id)),
      peers_(participant_),
      recorder_({.interval = std::chrono::milliseconds(static_cast<int>(config.recorder.commit_ms))}),
      topics_(participant_, recorder_), wiring_(config_.stages, topics_, *this),
      loops_(wiring_.stages(), topics_, clock_) {}

void Daemon::Impl::run() {
  if (config_.realtime.lock_memory) {
    for (const std::string &sentence : runtime::lock_memory()) {
      spdlog::warn("memory: {}", sentence);
    }
  }
  record_truth();
  asio::signal_set signals(io_, SIGINT, SIGTERM);
  signals.async_wait([this](const auto &error, int signal) {
    if (!error) {
      spdlog::info("{}: ending", signal == SIGTERM ? "SIGTERM" : "SIGINT");
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
  watchdog.ready("serving DDS domain " + std::to_string(config_.domain_id));
  spdlog::info("bregmad serves DDS domain {}", config_.domain_id);
  io_.run();

  watchdog.stopping();
  loops_.stop();
  workers_.join();
  // The final message on the health topic, with the final counts of the loops.
  wiring_.find(HealthStage::kName)
      ->step({.utc_ns = clock_.now_ns(), .monotonic_ns = clock_.monotonic_ns(), .boot_ns = clock_.boot_ns()});
  if (const auto closed = recorder_.close(); !closed) {
    spdlog::error("{}", closed.error().message);
  }
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

// Adds the loops and participants with another wire version; logs changes of the latter.
void Daemon::Impl::complete(wire::SystemHealth &health) {
  loops_.add_health(health);
  peers_.update();
  const auto others = peers_.of_another_wire();
  health.other_wire = static_cast<std::uint32_t>(others.size());
  if (std::string text = dds::other_wire_text(others); text != other_wire_) {
    spdlog::warn("wire: {}", text.empty() ? "no participant of another wire is left" : text);
    other_wire_ = std::move(text);
  }
}

} // namespace bregma::server
