// What a stage may ask of the process around it. bregmad answers with its log, recorder and loops; the base class is
// the answer of a test, where nothing is recorded and no time passes in a step.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "idl/topics.hpp"
#include "server/recording/recorder.hpp"

namespace bregma::server {

enum class LogLevel : std::uint8_t { kDebug, kInfo, kWarning, kError };

class Host {
public:
  virtual ~Host() = default;

  // ---- any thread, wait-free ----
  [[nodiscard]] virtual recording::RecorderStatus recorder() const noexcept { return {}; }
  [[nodiscard]] virtual std::uint64_t overruns() const noexcept { return 0; } // in all stages
  // The tissue solver has as many steps in a period as time allows; in virtual time, where a step takes none, a fixed
  // number, so that a run repeats.
  [[nodiscard]] virtual std::optional<int> fixed_solver_steps() const noexcept { return std::nullopt; }

  // ---- workers, and any stage while it is made ----
  // Of this run of the machine; see runtime::boot_id().
  [[nodiscard]] virtual std::array<std::uint8_t, 16> boot_id() const { return {}; }
  virtual void log(LogLevel, const std::string & /*line*/) {}
  // Runs the job elsewhere; the base class at once.
  virtual void run(std::function<void()> job) { job(); }
  // A case was loaded or closed (nullptr). The file that is recorded to from now on, empty for none; nullopt where
  // nothing is ever recorded.
  [[nodiscard]] virtual base::Result<std::optional<std::filesystem::path>>
  case_changed(const casefile::Case * /*loaded*/, std::int64_t /*utc_ns*/) {
    return std::nullopt;
  }
  // Adds what only the process knows: what the loops measured of themselves, participants that speak another wire.
  virtual void complete(wire::SystemHealth & /*health*/) {}
};

} // namespace bregma::server
