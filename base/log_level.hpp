// Severity of a log line, and its parameter: one meaning for the daemon and the drivers.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "base/parameters.hpp"

namespace bregma::base {

enum class LogLevel : std::uint8_t { kDebug, kInfo, kWarning, kError }; // increasing

inline void declare_log_level(ParameterSet &set, LogLevel *value, std::string text) {
  set.choice("log.level", value,
             {{"debug", LogLevel::kDebug},
              {"info", LogLevel::kInfo},
              {"warning", LogLevel::kWarning},
              {"error", LogLevel::kError}},
             std::move(text));
}

} // namespace bregma::base
