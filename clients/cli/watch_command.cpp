#include "clients/cli/watch_command.hpp"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <memory>
#include <string>
#include <thread>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>
#include <sys/ioctl.h>
#include <unistd.h>

#include "clients/cli/live_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/live/daemon_link.hpp"

namespace bregma::cli {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

struct WatchOptions {
  std::string tool;
  double rate_hz = 10.0;
  bool until_end = false;
  int while_pid = 0;
};

std::atomic<bool> interrupted{false};
static_assert(std::atomic<bool>::is_always_lock_free); // may be set by a signal handler

// Ctrl-C and SIGTERM end the loop instead of the process, so that the terminal is restored.
class Interruptible {
public:
  Interruptible() {
    interrupted = false;
    struct sigaction action {};
    action.sa_handler = [](int) { interrupted = true; };
    sigaction(SIGINT, &action, &old_int_);
    sigaction(SIGTERM, &action, &old_term_);
  }
  ~Interruptible() {
    sigaction(SIGINT, &old_int_, nullptr);
    sigaction(SIGTERM, &old_term_, nullptr);
  }
  Interruptible(const Interruptible &) = delete;
  Interruptible &operator=(const Interruptible &) = delete;

private:
  struct sigaction old_int_ {};
  struct sigaction old_term_ {};
};

// Uses the terminal's alternate screen, without a cursor, during the object's lifetime.
class Screen {
public:
  Screen() { print("\x1b[?1049h\x1b[?25l"); }
  ~Screen() { print("\x1b[?25h\x1b[?1049l"); }
  Screen(const Screen &) = delete;
  Screen &operator=(const Screen &) = delete;

  // Overwrites the last output, which avoids flicker. Lines are wrapped here: the terminal would cut or shift them.
  static void draw(const std::string &text) {
    winsize size{};
    const bool known = ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
    std::string out = "\x1b[H";
    for (const char c : wrapped(text, known ? size.ws_col : 80)) {
      out += c == '\n' ? std::string("\x1b[K\r\n") : std::string(1, c);
    }
    print(out + "\x1b[J");
  }
};

// A zombie counts as ended: it only waits for its parent.
bool process_runs(int pid) {
  if (kill(pid, 0) != 0 && errno == ESRCH) {
    return false;
  }
  std::ifstream stat("/proc/" + std::to_string(pid) + "/stat");
  const std::string text((std::istreambuf_iterator<char>(stat)), std::istreambuf_iterator<char>());
  const auto name_end = text.rfind(')'); // a name may contain any character
  return name_end == std::string::npos || name_end + 2 >= text.size() || text[name_end + 2] != 'Z';
}

// The condition of --until-end: the daemon has ended, or its case was closed.
class EndOfSession {
public:
  bool reached(const live::Snapshot &snapshot, const live::Now &now) {
    if (live::silence_ns(snapshot, now.boot_ns).value_or(0) >= live::kDaemonSilent_ns) { // a restart is shorter
      return true;
    }
    if (!snapshot.health) {
      return false;
    }
    const bool open = snapshot.health->session != bregma_wire_SESSION_IDLE;
    was_open_ = was_open_ || open;
    return was_open_ && !open;
  }

private:
  bool was_open_ = false;
};

constexpr std::int64_t kUnchanged_ns = 10'000'000'000; // a line that has not changed is printed again after this time

int watch(const WatchOptions &options, const Context &context) {
  const Interruptible signals;
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kReads, context.wait_s);
  if (auto there = link.wait_for_daemon(); !there) {
    return fail(there.error());
  }
  link.settle();

  const bool terminal = !context.json && isatty(STDOUT_FILENO) != 0;
  const bool lines = !context.json && !terminal;
  const double rate_hz = lines ? std::min(options.rate_hz, 1.0) : options.rate_hz;
  const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz));
  auto screen = terminal ? std::make_unique<Screen>() : nullptr;
  EndOfSession end;
  auto next = Clock::now();
  live::Now now;
  bool ended = false;
  std::string last_line;
  std::int64_t next_line_ns = 0;
  do {
    (void)link.update(0ns);
    now = live::Now::read();
    if (terminal) {
      Screen::draw(watch_table(link.snapshot(), options.tool, now) + "\nCtrl-C ends\n");
    } else if (lines) {
      const std::string line = watch_line(link.snapshot(), options.tool, now);
      if (line != last_line || now.boot_ns >= next_line_ns) { // what stands still is repeated as a sign of life only
        print(line + "\n");
        last_line = line;
        next_line_ns = now.boot_ns + kUnchanged_ns;
      }
    } else {
      print(json_text(watch_json(link.snapshot(), options.tool, now)) + "\n");
    }
    std::fflush(stdout);
    next = std::max(next + period, Clock::now()); // periods during which this process was stopped are skipped
    while (Clock::now() < next && !interrupted) {
      (void)link.update(std::min<Clock::duration>(next - Clock::now(), 50ms)); // takes samples as they arrive,
      std::this_thread::sleep_for(2ms);                                        // those of all tools together
    }
    ended = (options.until_end && end.reached(link.snapshot(), live::Now::read())) ||
            (options.while_pid > 0 && !process_runs(options.while_pid));
  } while (!interrupted && !ended && std::ferror(stdout) == 0);
  if (terminal) {
    screen.reset();
    print(watch_table(link.snapshot(), options.tool, now)); // the last state stays on the terminal
  }
  return kOk;
}

} // namespace

void add_watch_command(CLI::App &app, Context &context) {
  auto options = std::make_shared<WatchOptions>();
  auto *command = app.add_subcommand("watch", "Shows session, tools and alarms continuously");
  command->add_option("--tool", options->tool, "Only this tool");
  command->add_option("--rate", options->rate_hz, "Redraws (with --json: objects) per second")
      ->check(CLI::Range(0.1, 100.0))
      ->capture_default_str();
  command->add_flag("--until-end", options->until_end, "End when the daemon has stopped or its case was closed");
  command->add_option("--while-pid", options->while_pid, "End when this process has ended")->check(CLI::PositiveNumber);
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  command->footer("On a terminal: a table that is redrawn. Into a pipe: a line when something has changed, at most one "
                  "per second. With --json: one object per line.\n"
                  "A value that is not current is shown as \"-\" (null in JSON).\n\n"
                  "Examples:\n"
                  "  bregma watch --tool Probe\n"
                  "  bregma watch --json --rate 2 --until-end > run.jsonl");
  command->callback([options, &context] { context.run = [options, &context] { return watch(*options, context); }; });
}

} // namespace bregma::cli
