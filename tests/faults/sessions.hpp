// Sessions in each state, for a fault to meet: the operator's script from the start of the run to a last action that
// must succeed after the fault, and the state directory of the daemon at the start.
#pragma once

#include <filesystem>
#include <string>

#include "casefile/case.hpp"
#include "drivers/sim/scenario.hpp"
#include "server/config.hpp"
#include "tests/component/operation_fixture.hpp"
#include "tests/faults/cell.hpp"

namespace bregma::faults {

// The case, and the snapshots of a session with calibrated tools and of a registered one. Made once for all runs, in
// virtual time.
class Sessions {
public:
  static constexpr std::uint64_t kPatientSeed = 11;

  // Throws std::runtime_error if the operation cannot be brought so far.
  Sessions();

  [[nodiscard]] const casefile::Case &loaded() const { return folder_.loaded(); }
  // Copies what a daemon finds at its start.
  void prepare(During session, const std::filesystem::path &state_directory) const;

private:
  test::CaseFolder folder_;
  test::TemporaryFolder calibrated_, registered_;
};

// The daemon of every run: without a tissue model, one check touch is enough to verify.
[[nodiscard]] server::Config daemon_config(const std::filesystem::path &state_directory);
// The tool whose poses are judged for pauses.
[[nodiscard]] const char *tool_of(During session);
[[nodiscard]] sim::Scenario scenario_of(const Cell &cell, During session);

} // namespace bregma::faults
