// Services of the process for stages. bregmad implements them with its log, recorder and loops. The base class is the
// implementation for tests, without recording and with steps that take no time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "base/log_level.hpp"
#include "base/result.hpp"
#include "casefile/case.hpp"
#include "idl/host_clock.hpp"
#include "idl/topics.hpp"
#include "server/recording/recorder.hpp"
#include "server/session/work.hpp"
#include "server/stages/monitoring/alarm_conditions.hpp"

namespace bregma::server {

using base::LogLevel;

class Host {
public:
  virtual ~Host() = default;

  // ---- any thread, wait-free ----
  [[nodiscard]] virtual recording::RecorderStatus recorder() const noexcept { return {}; }
  // Number of steps of the tissue solver per period: as many as time allows, or in virtual time a fixed number, so that
  // runs are reproducible.
  [[nodiscard]] virtual std::optional<int> fixed_solver_steps() const noexcept { return std::nullopt; }

  // ---- workers, and any stage during construction ----
  // Identity of the machine's current boot.
  [[nodiscard]] virtual wire::BootIdentity boot_id() const { return {}; }
  // SystemHealth::run_id of this process.
  [[nodiscard]] virtual std::uint64_t run_id() const { return 0; }
  virtual void log(LogLevel, const std::string & /*line*/) {}
  // Runs the job on another thread (server/session/work.hpp); the base class runs it at once.
  virtual void run_elsewhere(Work /*work*/, const std::function<void()> &job) { job(); }
  // Called within Work::kSave: a case was loaded or closed (nullptr). Returns the file of the new recording, empty if
  // there is none; nullopt if recording is disabled.
  [[nodiscard]] virtual base::Result<std::optional<std::filesystem::path>>
  case_changed(const casefile::Case * /*loaded*/, std::int64_t /*utc_ns*/) {
    return std::nullopt;
  }
  // Alarm conditions of the process, read by the session's stage; nullptr: there are none.
  [[nodiscard]] virtual AlarmEvents *conditions() noexcept { return nullptr; }
  // Adds data of the process: its identity, measurements of the loops, participants with another wire version.
  virtual void complete(wire::SystemHealth & /*health*/) {}
};

} // namespace bregma::server
