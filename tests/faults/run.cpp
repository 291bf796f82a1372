#include "tests/faults/run.hpp"

#include "tests/faults/arm_run.hpp"

namespace bregma::faults {

std::uint64_t seed_of(const Cell &cell, During session) {
  std::uint64_t hash = 0xcbf29ce484222325U; // FNV-1a: a new cell does not change the seeds of the others
  for (const char c : cell.name() + name_of(session)) {
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
  }
  return hash % 100'000;
}

Outcome run(const Sessions &sessions, const Cell &cell, During session) {
  if (is_arm_cell(cell)) {
    return run_arm(cell, session);
  }
  constexpr double kLimit_s = 300.0; // of virtual time, for a hang
  const test::TemporaryFolder state;
  sessions.prepare(session, state.path());
  test::VirtualOperation operation(sessions.loaded(), scenario_of(cell, session), Sessions::kPatientSeed,
                                   daemon_config(state.path()));
  FaultyLine line(cell, session, tool_of(session), seed_of(cell, session), operation);
  Judge judge(cell, session, tool_of(session), seed_of(cell, session), operation, line);
  operation.set_line(line);
  const std::int64_t began_ns = operation.now_ns();
  const bool came_to_its_end = operation.run(kLimit_s);
  judge.finish(came_to_its_end ? "" : operation.failure());
  return {judge.violations(), judge.figures(), static_cast<double>(operation.now_ns() - began_ns) * 1e-9};
}

} // namespace bregma::faults
