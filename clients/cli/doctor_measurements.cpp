#include "clients/cli/doctor_measurements.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <thread>
#include <unordered_map>

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "idl/dds.hpp"
#include "idl/names.hpp"
#include "server/runtime/realtime.hpp"

namespace bregma::cli {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kCommitBytes = 65536; // approximate size of one commit of the recorder
// QoS of the answers. The history is deep enough that an answer taken late is not replaced by the next one and counted
// as lost.
constexpr wire::Qos kAnswers = wire::qos::kTracker;

// Gives the thread the priority of the daemon's navigation loop, where the kernel allows it.
void set_up_like_a_loop() { (void)runtime::set_up_thread({.name = "dds-check", .fifo_priority = 70}); }

// Runs in the second process until it is killed.
void answer_frames(std::uint32_t domain) {
  set_up_like_a_loop();
  const dds::Participant participant(domain);
  dds::Reader<wire::TrackerFrame> frames(participant);
  const dds::Writer<wire::NavigationState> states(participant, kAnswers);
  dds::WaitSet wait(participant);
  wait.attach(frames);
  wire::NavigationState state{};
  for (;;) {
    (void)wait.wait(100ms);
    frames.take_each([&](const wire::TrackerFrame &frame, const dds::SampleInfo &) {
      state.frame = frame.frame;
      (void)states.write(state);
    });
    (void)frames.status(); // clears the status; see below
  }
}

base::Result<LoopbackQuality> measure_round_trips(std::uint32_t domain, double rate_hz,
                                                  std::chrono::nanoseconds duration) {
  const dds::Participant participant(domain);
  const dds::Writer<wire::TrackerFrame> frames(participant);
  dds::Reader<wire::NavigationState> states(participant, kAnswers);
  dds::WaitSet wait(participant);
  wait.attach(states);
  const auto patience = Clock::now() + 5s;
  while (frames.matched_readers() == 0 || states.matched_writers() == 0) {
    if (Clock::now() > patience) {
      return base::failure("no second process could be reached over DDS on domain " + std::to_string(domain));
    }
    std::this_thread::sleep_for(10ms);
  }
  std::this_thread::sleep_for(100ms); // the other side must have matched as well

  LoopbackQuality out;
  std::unordered_map<std::uint64_t, Clock::time_point> under_way;
  std::vector<double> round_trips_us;
  const auto take = [&] {
    states.take_each([&](const wire::NavigationState &state, const dds::SampleInfo &) {
      const auto sent = under_way.find(state.frame);
      if (sent != under_way.end()) {
        round_trips_us.push_back(std::chrono::duration<double, std::micro>(Clock::now() - sent->second).count());
        under_way.erase(sent);
      }
    });
    (void)states.status(); // clears the status after a change of liveliness or a missed deadline
  };
  wire::TrackerFrame frame{};
  (void)wire::set_name(frame.device, "Doctor");
  const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz));
  const auto start = Clock::now();
  for (auto next = start; next < start + duration; next += period) {
    ++frame.frame;
    under_way[frame.frame] = Clock::now();
    out.sent += frames.write(frame) ? 1 : 0;
    while (Clock::now() < next + period) {
      (void)wait.wait(next + period - Clock::now());
      take();
    }
  }
  const auto end = Clock::now() + 200ms;
  while (!under_way.empty() && Clock::now() < end) {
    (void)wait.wait(10ms);
    take();
  }
  out.round_trip_us = spread_of(std::move(round_trips_us));
  return out;
}

std::string reason() { return std::strerror(errno); } // NOLINT(concurrency-mt-unsafe): one thread

} // namespace

Spread spread_of(std::vector<double> values) {
  Spread out;
  out.count = values.size();
  if (values.empty()) {
    return out;
  }
  std::sort(values.begin(), values.end());
  const auto at = [&](double fraction) {
    const double rank = std::ceil(fraction * static_cast<double>(values.size()));
    return values[static_cast<std::size_t>(std::max(1.0, rank)) - 1];
  };
  out.p50 = at(0.5);
  out.p99 = at(0.99);
  out.p999 = at(0.999);
  out.max = values.back();
  return out;
}

EchoProcess::EchoProcess(std::uint32_t domain) : domain_(domain) {
  const pid_t parent = getpid();
  process_ = fork();
  if (process_ == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() == parent) { // otherwise the parent ended before prctl took effect
      try {
        answer_frames(domain);
      } catch (const std::exception &) {
        // The parent receives no answers and reports that.
      }
    }
    _exit(1);
  }
}

EchoProcess::~EchoProcess() {
  if (process_ > 0) {
    kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
  }
}

base::Result<LoopbackQuality> EchoProcess::measure(double rate_hz, std::chrono::nanoseconds duration) {
  base::Result<LoopbackQuality> out;
  std::thread([&] {
    set_up_like_a_loop();
    try {
      out = measure_round_trips(domain_, rate_hz, duration);
    } catch (const dds::Error &error) {
      out = base::failure(error.what());
    }
  }).join();
  return out;
}

base::Result<Spread> measure_disk(const std::filesystem::path &directory, int blocks) {
  std::string name = (directory / "bregma-doctor-XXXXXX").string();
  const int file = mkstemp(name.data());
  if (file < 0) {
    return base::failure(directory.string() + ": cannot be written: " + reason());
  }
  const std::vector<char> block(kCommitBytes, 'b');
  std::vector<double> times_ms;
  std::string problem;
  for (int i = 0; i < blocks && problem.empty(); ++i) {
    const auto start = Clock::now();
    if (write(file, block.data(), block.size()) != static_cast<ssize_t>(block.size()) || fsync(file) != 0) {
      problem = directory.string() + ": cannot be written: " + reason();
    }
    times_ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
  }
  close(file);
  unlink(name.c_str());
  if (!problem.empty()) {
    return base::failure(problem);
  }
  return spread_of(std::move(times_ms));
}

base::Result<casefile::RecordingSpace> recording_space(const std::filesystem::path &directory) {
  std::error_code code;
  const auto space = std::filesystem::space(directory, code);
  if (code) {
    return base::failure(directory.string() + ": its free space is not known: " + code.message());
  }
  return casefile::RecordingSpace{space.available, casefile::kTypicalBytesPerSecond};
}

std::filesystem::path existing_part(std::filesystem::path directory) {
  std::error_code ignored;
  while (!std::filesystem::is_directory(directory, ignored) && directory.has_relative_path()) {
    directory = directory.parent_path();
  }
  return directory.empty() ? std::filesystem::path(".") : directory;
}

} // namespace bregma::cli
