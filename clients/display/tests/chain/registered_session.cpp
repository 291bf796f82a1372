// Runs an operation in virtual time and leaves its session in a state directory, from which bregmad goes on.
//
//   display_registered_session CASE SCENARIO.toml STATE_DIRECTORY SEED
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

#include "casefile/case.hpp"
#include "drivers/sim/scenario.hpp"
#include "server/stages/session/stage.hpp"
#include "tests/support/virtual_operation.hpp"

namespace {

int fail(const std::string &reason) {
  std::fprintf(stderr, "display_registered_session: %s\n", reason.c_str());
  return 1;
}

int run(char **argv) {
  using namespace bregma;
  const auto a_case = casefile::load_case(argv[1]);
  if (!a_case) {
    return fail(a_case.error().message);
  }
  const auto scenario = sim::load_scenario(argv[2]);
  if (!scenario) {
    return fail(scenario.error().message);
  }
  server::Config config = test::quick_config();
  config.stages.of<server::SessionParameters>().state_directory = argv[3];
  test::VirtualOperation operation(*a_case, *scenario, std::strtoull(argv[4], nullptr, 10), config);
  return operation.run() ? 0 : fail(operation.failure());
}

} // namespace

int main(int argc, char **argv) {
  if (argc != 5) {
    std::fputs("usage: display_registered_session CASE SCENARIO.toml STATE_DIRECTORY SEED\n", stderr);
    return 2;
  }
  try {
    return run(argv);
  } catch (const std::exception &error) {
    return fail(error.what());
  }
}
