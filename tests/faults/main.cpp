// The fault matrix in virtual time (docs/faults.md): ./dev faults.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <string>

#include <CLI/CLI.hpp>

#include "tests/faults/campaign.hpp"
#include "tests/faults/kills.hpp"
#include "tests/faults/report.hpp"

namespace {

using namespace bregma::faults;

struct Options {
  bool json = false;
  bool quick = false;
  std::string only;
  std::string session;
  int kills = 0;
};

constexpr std::uint64_t kKillSeed = 1;
constexpr double kMaxLost_ms = 100.0; // of the record, at its begin and at its end
constexpr double kMaxRegistered_s = 2.0;

std::vector<Planned> plan(const Options &options) {
  std::vector<Planned> out = options.quick ? sampled_runs() : all_runs();
  std::erase_if(out, [&](const Planned &planned) {
    return planned.cell->name().find(options.only) == std::string::npos ||
           (!options.session.empty() && options.session != name_of(planned.session));
  });
  return out;
}

int execute(const Options &options) {
  Campaign campaign;
  std::fputs(options.json ? "" : table_header().c_str(), stdout);
  campaign.run(plan(options), [&](const Planned &planned, const Outcome &outcome) {
    std::fputs((options.json ? json_line(planned, outcome) : table_rows(planned, outcome)).c_str(), stdout);
    std::fflush(stdout);
  });
  const bool partial = !options.only.empty() || !options.session.empty();
  const auto outdated = partial ? std::vector<const KnownFailure *>() : campaign.outdated();
  for (const KnownFailure *known : outdated) {
    std::fprintf(stderr, "faults: '%s' no longer breaks '%s': remove it from tests/faults/known_failures.txt\n",
                 known->cell.c_str(), known->rule.c_str());
  }
  std::fprintf(stderr, "%d runs hold, %d fail as known, %d fail\n", campaign.count(Verdict::kHolds),
               campaign.count(Verdict::kKnownFailure), campaign.count(Verdict::kFails));
  return campaign.count(Verdict::kFails) == 0 && outdated.empty() ? 0 : 1;
}

int execute_kills(const Options &options) {
  std::fprintf(stderr, "SIGKILL of bregmad under load on every core, seed %d\n", static_cast<int>(kKillSeed));
  Kills kills(kKillSeed);
  int failed = 0;
  double most_lost_ms = 0.0, longest_s = 0.0;
  for (int i = 1; i <= options.kills; ++i) {
    const Kill kill = kills.next();
    const bool holds = kill.failure.empty() && kill.late_ms <= kMaxLost_ms && kill.lost_ms <= kMaxLost_ms &&
                       kill.registered_s <= kMaxRegistered_s;
    failed += holds ? 0 : 1;
    most_lost_ms = std::max({most_lost_ms, kill.late_ms, kill.lost_ms});
    longest_s = std::max(longest_s, kill.registered_s);
    std::fputs((options.json ? json_line(i, kill, holds) : table_row(i, kill, holds)).c_str(), stdout);
    std::fflush(stdout);
  }
  std::fprintf(stderr, "%d of %d hold; at most %.0f ms of record lost, registered again within %.2f s\n",
               options.kills - failed, options.kills, most_lost_ms, longest_s);
  return failed == 0 ? 0 : 1;
}

} // namespace

int main(int argc, char **argv) {
  Options options;
  CLI::App app("The fault matrix: every cell in every session, in virtual time, with an independent judge");
  app.add_flag("--json", options.json, "one JSON object per run");
  app.add_flag("--quick", options.quick, "the sample of the test: every cell in two sessions");
  app.add_option("--only", options.only, "cells whose name contains this, such as tracker/late");
  app.add_option("--session", options.session, "one session, such as navigating");
  app.add_option("--kills", options.kills, "instead: SIGKILL of a real daemon this often, under load on every core");
  CLI11_PARSE(app, argc, argv);
  try {
    return options.kills > 0 ? execute_kills(options) : execute(options);
  } catch (const std::exception &error) {
    std::fprintf(stderr, "faults: %s\n", error.what());
    return 2;
  }
}
