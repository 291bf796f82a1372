#include "clients/cli/mri/register_watch.hpp"

#include <chrono>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>

#include "clients/cli/mri/scanner_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/live/daemon_link.hpp"
#include "idl/dds.hpp"

namespace bregma::cli {

namespace {

using namespace std::chrono_literals;

constexpr auto kLook = 20ms;

// What makes another line: not every slice of a series.
std::string digest(const wire::ScannerRegistration &state) {
  return std::to_string(state.revision) + " " + std::to_string(state.accepted_revision) + " " +
         std::to_string(state.validity) + " " + std::to_string(state.slices_refused) + " " +
         std::to_string(state.slices / 20) + " " + std::to_string(state.field_status) +
         scanner_line(state).substr(0, 60);
}

} // namespace

int watch_registration(WatchUntil until, const Context &context) {
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kReads, context.wait_s);
  dds::Reader<wire::ScannerRegistration> reader(link.participant());
  if (auto there = link.wait_for_daemon(); !there) {
    return fail(there.error());
  }
  std::string last;
  std::optional<wire::ScannerRegistration> state;
  while (std::ferror(stdout) == 0) {
    (void)link.update(0ns);
    reader.take_each([&](const wire::ScannerRegistration &sample, const auto &) { state = sample; });
    if (state && digest(*state) != last) {
      const bool rest = state->activity == bregma_wire_SCANNER_WAITS || state->activity == bregma_wire_SCANNER_FAILED;
      last = digest(*state);
      print(context.json ? json_text(scanner_json(*state)) + "\n"
            : rest       ? scanner_text(*state) + "\n"
                         : scanner_line(*state) + "\n");
      std::fflush(stdout);
    }
    if (until == WatchUntil::kAccepted && state && state->step == bregma_wire_SCANNER_STEP_DONE) {
      return state->validity == bregma_wire_SCANNER_VALID ? kOk : kRefused;
    }
    if (until == WatchUntil::kOperator && state && state->activity == bregma_wire_SCANNER_WAITS) {
      return kOk;
    }
    if (until != WatchUntil::kDaemonEnds && state && state->activity == bregma_wire_SCANNER_FAILED) {
      return kRefused;
    }
    if (!live::alive(link.snapshot(), live::Now::read().boot_ns)) {
      return fail("the daemon has ended");
    }
    std::this_thread::sleep_for(kLook);
  }
  return kOk;
}

} // namespace bregma::cli
