#include "server/runtime/logging.hpp"

#include <array>
#include <csignal>
#include <cstdio>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include <unistd.h>

#include <spdlog/async.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/spdlog.h>

#include "server/runtime/log_output.hpp"

namespace bregma::runtime {
namespace {

constexpr std::size_t kQueue = 8192;
constexpr std::size_t kFileBytes = 10'000'000;
constexpr std::size_t kFiles = 5;
constexpr const char *kPattern = "%Y-%m-%dT%H:%M:%S.%fZ %^%l%$ %*"; // %*: EscapedText

class EscapedText final : public spdlog::custom_flag_formatter {
public:
  void format(const spdlog::details::log_msg &message, const std::tm &, spdlog::memory_buf_t &out) override {
    const std::string text = escaped({message.payload.data(), message.payload.size()});
    out.append(text.data(), text.data() + text.size());
  }
  [[nodiscard]] std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<EscapedText>();
  }
};

// Standard error, with the level in colour on a terminal.
class ConsoleSink final : public spdlog::sinks::base_sink<std::mutex> {
protected:
  void sink_it_(const spdlog::details::log_msg &message) override {
    spdlog::memory_buf_t buffer;
    formatter_->format(message, buffer);
    std::string line(buffer.data(), buffer.size());
    if (output_.terminal() && message.color_range_end > message.color_range_start) {
      constexpr std::array kColours{"", "\033[36m", "\033[32m", "\033[33m", "\033[31m", "\033[1m\033[41m", ""};
      line.insert(message.color_range_end, "\033[m");
      line.insert(message.color_range_start, kColours[static_cast<std::size_t>(message.level)]);
    }
    (void)output_.write(line); // it counts the lines that nobody reads
  }
  void flush_() override {} // nothing is buffered

private:
  LogOutput output_{STDERR_FILENO};
};

// Number of bytes of the character of UTF-8 at the front; 0 if it is invalid.
std::size_t character_bytes(std::string_view text) {
  const auto byte = [text](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const std::size_t bytes = byte(0) < 0x80   ? 1
                            : byte(0) < 0xC2 ? 0
                            : byte(0) < 0xE0 ? 2
                            : byte(0) < 0xF0 ? 3
                            : byte(0) < 0xF5 ? 4
                                             : 0;
  if (bytes > text.size()) {
    return 0;
  }
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xC0U) != 0x80U) {
      return 0;
    }
  }
  return bytes;
}

// Of ASCII, and of C1: 0xC2 0x80 to 0xC2 0x9F in UTF-8.
bool is_control(std::string_view character) {
  const auto first = static_cast<unsigned char>(character[0]);
  return first < 0x20 || first == 0x7F ||
         (character.size() == 2 && first == 0xC2 && static_cast<unsigned char>(character[1]) < 0xA0);
}

} // namespace

std::string escaped(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const std::size_t valid = character_bytes(text);
    const std::string_view character = text.substr(0, valid == 0 ? 1 : valid);
    if (valid > 0 && !is_control(character)) {
      out += character;
    } else {
      for (const char byte : character) {
        std::array<char, 5> hex{};
        (void)std::snprintf(hex.data(), hex.size(), "\\x%02x", static_cast<unsigned>(static_cast<unsigned char>(byte)));
        out += hex.data();
      }
    }
    text.remove_prefix(character.size());
  }
  return out;
}

base::Result<void> start_logging(const LogOptions &options) {
  const auto level = spdlog::level::from_str(options.level);
  if (level == spdlog::level::off && options.level != "off") {
    return base::failure("log level " + options.level + ": must be trace, debug, info, warn, error, critical or off");
  }
  (void)std::signal(SIGPIPE, SIG_IGN); // the end of the program that reads the log does not end this one
  try {
    std::vector<spdlog::sink_ptr> sinks;
    if (options.console) {
      sinks.push_back(std::make_shared<ConsoleSink>());
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
    auto formatter = std::make_unique<spdlog::pattern_formatter>(spdlog::pattern_time_type::utc);
    formatter->add_flag<EscapedText>('*').set_pattern(kPattern);
    logger->set_formatter(std::move(formatter));
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
