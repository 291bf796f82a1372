// bregma-case-server: beside the daemon, sends the files of its case to displays that ask for them.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cinttypes>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <system_error>

#include <unistd.h>

#include <CLI/CLI.hpp>

#include "base/standard_output.hpp"
#include "clients/case_server/case_bundle.hpp"
#include "clients/live/daemon_link.hpp"
#include "idl/boot_clock.hpp"

namespace {

using namespace bregma;
using namespace std::chrono_literals;

constexpr int kBadInput = 2;
constexpr int kTissueElements = 20'000; // default of deformation.elements

std::atomic<bool> stopped{false};

struct Shown {
  std::string folder; // empty: no case
  std::filesystem::file_time_type changed;
  friend bool operator==(const Shown &, const Shown &) = default;
};

// The case that the daemon of this host has loaded. Without a living daemon the last one stays on offer: a display may
// still be fetching it, and the daemon restores it after a restart.
Shown shown_case(live::DaemonLink &link, const Shown &last) {
  const auto &health = link.snapshot().health;
  const auto boot_id = wire::boot_id();
  if (!health || !live::alive(link.snapshot(), live::Now::read().boot_ns) ||
      !std::equal(boot_id.begin(), boot_id.end(), std::begin(health->boot_id))) {
    return last;
  }
  Shown out;
  const auto &folder = health->case_folder;
  out.folder = std::string(folder, strnlen(folder, sizeof folder));
  std::error_code missing;
  if (!out.folder.empty()) {
    out.changed = std::filesystem::last_write_time(std::filesystem::path(out.folder) / "case.toml", missing);
  }
  return out;
}

void offer(casefiles::CaseSender &sender, const Shown &shown, int tissue_elements) {
  if (shown.folder.empty()) {
    return sender.offer_none();
  }
  sender.offer_preparing({});
  auto bundle = case_server::bundle_of(shown.folder, tissue_elements);
  if (!bundle) {
    std::fprintf(stderr, "bregma-case-server: %s\n", bundle.error().message.c_str());
    // Its text leaves this host: without the folder, whose name may be the patient's.
    return sender.offer_failed({}, "the files of the case cannot be read; the log of bregma-case-server says why");
  }
  std::printf("offers case %s\n", bundle->case_id.c_str());
  std::fflush(stdout);
  sender.offer(std::move(*bundle));
}

std::string host_name() {
  char name[32] = {};
  return gethostname(name, sizeof name - 1) == 0 ? name : "unknown";
}

int serve(int argc, char **argv) {
  CLI::App app("bregma-case-server, sends the files of bregmad's case to displays on other hosts",
               "bregma-case-server");
  app.set_version_flag("--version", "bregma-case-server " BREGMA_VERSION " (" BREGMA_BUILD ")");
  std::uint32_t domain = 0;
  int tissue_elements = kTissueElements;
  app.add_option("--domain", domain, "DDS domain of the daemon")
      ->envname("BREGMA_DOMAIN")
      ->check(CLI::Range(0, 230))
      ->capture_default_str();
  app.add_option("--tissue-elements", tissue_elements,
                 "deformation.elements of the daemon's configuration; 0: without the tissue's mesh")
      ->check(CLI::Range(0, 200'000))
      ->capture_default_str();
  app.footer("Examples:\n"
             "  bregma-case-server\n"
             "  bregma-case-server --domain 7\n"
             "It runs on the daemon's host, as a user that may read the case folders.\n"
             "Exit codes: 0 ended by a signal; 2 it could not run.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return base::end_output("bregma-case-server", app.exit(error) == 0 ? 0 : kBadInput);
  }
  std::signal(SIGINT, [](int) { stopped = true; });
  std::signal(SIGTERM, [](int) { stopped = true; });

  live::DaemonLink link(domain, live::DaemonLink::Role::kReads);
  casefiles::CaseSender sender(link.participant(), host_name());
  Shown last;
  std::uint64_t dropped = 0;
  while (!stopped) {
    (void)link.update(0ns);
    if (const Shown now = shown_case(link, last); now != last) {
      last = now;
      offer(sender, now, tissue_elements);
    }
    sender.serve(20ms);
    if (sender.dropped_chunks() != dropped) {
      dropped = sender.dropped_chunks();
      std::fprintf(
          stderr,
          "bregma-case-server: %" PRIu64
          " chunks were asked for beyond the queue: many displays fetch the case at once, and wait longer for it\n",
          dropped);
    }
  }
  return 0;
}

} // namespace

int main(int argc, char **argv) {
  try {
    return serve(argc, argv);
  } catch (const std::exception &error) {
    std::fprintf(stderr, "bregma-case-server: %s\n", error.what());
    return kBadInput;
  }
}
