// All parameters of bregmad. Names end with the unit. Defaults are here, ranges and texts in config.cpp.
#pragma once

#include <cstdint>
#include <string>

#include "base/parameters.hpp"
#include "base/result.hpp"
#include "server/stages/host.hpp"
#include "server/stages/parameters.hpp"

namespace bregma::server {

struct Config {
  std::int64_t domain_id = 0;

  StageParameters stages;

  struct {
    bool enabled = true;
    double commit_ms = 20.0;
    bool truth = true; // record SimulatedTruth if a simulator publishes it
  } recorder;

  struct {
    std::string file; // empty: console only
    LogLevel level = LogLevel::kInfo;
  } log;

  struct {
    bool lock_memory = true;
  } realtime;
};

// Declares all parameters. config must outlive the set.
[[nodiscard]] base::ParameterSet declare(Config &config);
// Checks beyond ranges. Errors name key and value.
[[nodiscard]] base::Result<void> check(Config &config);

} // namespace bregma::server
