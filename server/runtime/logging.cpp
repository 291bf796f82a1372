#include "server/runtime/logging.hpp"

#include <memory>
#include <vector>

#include <spdlog/async.h>
#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

namespace bregma::runtime {
namespace {

constexpr std::size_t kQueue = 8192;
constexpr std::size_t kFileBytes = 10'000'000;
constexpr std::size_t kFiles = 5;
constexpr const char *kPattern = "%Y-%m-%dT%H:%M:%S.%fZ %^%l%$ %v";

} // namespace

base::Result<void> start_logging(const LogOptions &options) {
  const auto level = spdlog::level::from_str(options.level);
  if (level == spdlog::level::off && options.level != "off") {
    return base::failure("log level " + options.level + ": must be trace, debug, info, warn, error, critical or off");
  }
  try {
    std::vector<spdlog::sink_ptr> sinks;
    if (options.console) {
      sinks.push_back(std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
    }
    if (!options.file.empty()) {
      sinks.push_back(
          std::make_shared<spdlog::sinks::rotating_file_sink_mt>(options.file.string(), kFileBytes, kFiles));
    }
    spdlog::init_thread_pool(kQueue, 1);
    // Drops the oldest line, so that a blocked console does not block the callers.
    auto logger = std::make_shared<spdlog::async_logger>("bregmad", sinks.begin(), sinks.end(), spdlog::thread_pool(),
                                                         spdlog::async_overflow_policy::overrun_oldest);
    logger->set_level(level);
    logger->set_pattern(kPattern, spdlog::pattern_time_type::utc);
    logger->flush_on(spdlog::level::warn);
    spdlog::set_default_logger(std::move(logger));
    spdlog::flush_every(std::chrono::seconds(1));
  } catch (const spdlog::spdlog_ex &error) {
    return base::failure("log file " + options.file.string() + ": " + error.what());
  }
  return {};
}

void stop_logging() { spdlog::shutdown(); }

} // namespace bregma::runtime
