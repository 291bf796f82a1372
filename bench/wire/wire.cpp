// Cost of extensible types: TrackerFrame and NavigationState as they are (@appendable), compared with the same types as
// @final. Size and time of a round trip to another process, measured alternately within one run.
#include <chrono>
#include <csignal>
#include <cstdint>
#include <iostream>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <sys/wait.h>
#include <unistd.h>

#include "bench/record.hpp"
#include "bench/wire/serialized_size.hpp"
#include "final_state.h"
#include "final_streams.h"
#include "idl/names.hpp"

namespace {

enum Way : int { kThere, kBack };

// A sample to the other process or from it: separate types, so that each direction has its own topic.
template <class Sample, Way way> struct Going : Sample {};

template <class Sample> struct Named; // kNames, per direction
#define BENCH_NAMED(Type, name)                                                                                        \
  template <> struct Named<Type> {                                                                                     \
    static constexpr const char *kNames[] = {name "There", name "Back"};                                               \
    static const dds_topic_descriptor_t &descriptor() { return Type##_desc; }                                          \
  }
BENCH_NAMED(bregma_wire_TrackerFrame, "TrackerFrame");
BENCH_NAMED(bregma_wire_NavigationState, "NavigationState");
BENCH_NAMED(bregma_final_wire_TrackerFrame, "FinalTrackerFrame");
BENCH_NAMED(bregma_final_wire_NavigationState, "FinalNavigationState");

} // namespace

template <class Sample, Way way> struct bregma::wire::Topic<Going<Sample, way>> {
  static constexpr const char *kName = Named<Sample>::kNames[way];
  static constexpr Qos kQos = qos::kTruth; // best effort only
  static const dds_topic_descriptor_t &descriptor() { return Named<Sample>::descriptor(); }
};

namespace {

using namespace bregma;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

// The other process returns every received sample.
template <class Sample> class Echo {
public:
  Echo(const dds::Participant &participant, dds::WaitSet &wait) : reader_(participant), writer_(participant) {
    wait.attach(reader_);
  }
  void step() {
    reader_.take_each([this](const auto &sample, const auto &) {
      (void)writer_.write(static_cast<const Going<Sample, kBack> &>(static_cast<const Sample &>(sample)));
    });
  }

private:
  dds::Reader<Going<Sample, kThere>> reader_;
  dds::Writer<Going<Sample, kBack>> writer_;
};

[[noreturn]] void run_echo(std::uint32_t domain, int parent) {
  const dds::Participant participant(domain);
  dds::WaitSet wait(participant);
  Echo<bregma_wire_TrackerFrame> frames(participant, wait);
  Echo<bregma_wire_NavigationState> states(participant, wait);
  Echo<bregma_final_wire_TrackerFrame> final_frames(participant, wait);
  Echo<bregma_final_wire_NavigationState> final_states(participant, wait);
  while (getppid() == parent) {
    wait.wait(100ms);
    frames.step();
    states.step();
    final_frames.step();
    final_states.step();
  }
  _exit(0);
}

template <class Sample> class Caller {
public:
  Caller(const dds::Participant &participant, Sample sample)
      : sample_{sample}, writer_(participant), reader_(participant), wait_(participant) {
    wait_.attach(reader_);
    for (int i = 0; i < 500 && (writer_.matched_readers() == 0 || reader_.matched_writers() == 0); ++i) {
      usleep(10'000);
    }
  }

  // Durations of `count` successive round trips, in microseconds.
  void measure(int trips, std::vector<double> &out) {
    int lost = 0;
    for (int done = 0; done < trips;) {
      const auto began = Clock::now();
      if (round_trip()) {
        out.push_back(std::chrono::duration<double, std::micro>(Clock::now() - began).count());
        ++done;
      } else if (++lost > kMaxLost) { // best effort: some may be lost, at first until the echo process has matched
        throw std::runtime_error("samples are not returned");
      }
    }
  }

private:
  static constexpr int kMaxLost = 50;
  bool round_trip() {
    if (!writer_.write(sample_)) {
      return false;
    }
    const auto end = Clock::now() + 200ms;
    while (Clock::now() < end) {
      wait_.wait(50ms);
      if (reader_.take_each([](const auto &, const auto &) {}) > 0) {
        return true;
      }
    }
    return false;
  }

  Going<Sample, kThere> sample_;
  dds::Writer<Going<Sample, kThere>> writer_;
  dds::Reader<Going<Sample, kBack>> reader_;
  dds::WaitSet wait_;
};

// No field is 0, so that no special case makes the copy cheaper.
template <class Sample> Sample filled() {
  Sample out{};
  auto *bytes = reinterpret_cast<unsigned char *>(&out);
  for (std::size_t i = 0; i < sizeof out; ++i) {
    bytes[i] = static_cast<unsigned char>(1 + i % 31);
  }
  return out;
}

template <class Growing, class Fixed>
void compare(bench::Report &report, const dds::Participant &participant, const std::string &name, bool quick) {
  const auto growing = filled<Growing>();
  const auto fixed = filled<Fixed>();
  const auto size = [&](const auto &descriptor, const void *sample) {
    return static_cast<double>(bench::serialized_size(participant, descriptor, sample));
  };
  report.add(bench::with_peer(bench::figure(name + ", serialized", size(Named<Growing>::descriptor(), &growing), "B"),
                              size(Named<Fixed>::descriptor(), &fixed), "@final"));

  Caller<Growing> growing_caller(participant, growing);
  Caller<Fixed> fixed_caller(participant, fixed);
  const int turns = quick ? 50 : 800; // short, so that other load affects both equally
  const int trips = 50;
  std::vector<double> growing_us;
  std::vector<double> fixed_us;
  growing_caller.measure(trips, growing_us); // warm-up
  fixed_caller.measure(trips, fixed_us);
  growing_us.clear();
  fixed_us.clear();
  for (int turn = 0; turn < turns; ++turn) {
    growing_caller.measure(trips, growing_us);
    fixed_caller.measure(trips, fixed_us);
  }
  const auto add = [&](double p, const char *what) {
    const double peer = bench::percentile(fixed_us, p);
    bench::Record record = p < 0.6 ? bench::at_most(name + what, bench::percentile(growing_us, p), "us", 1.1 * peer)
                                   : bench::figure(name + what, bench::percentile(growing_us, p), "us");
    report.add(bench::with_peer(std::move(record), peer, "@final"));
  };
  add(0.5, ", round trip, median");
  add(0.99, ", round trip, 99 %");
}

} // namespace

int main(int argc, char **argv) {
  CLI::App app("What it costs that the wire's types can grow");
  bench::Options options;
  bench::add_options(app, options);
  CLI11_PARSE(app, argc, argv);
  const std::uint32_t domain = 100 + static_cast<std::uint32_t>(getpid()) % 100;
  const int parent = getpid();
  const pid_t echo = fork(); // before the first thread
  if (echo == 0) {
    run_echo(domain, parent);
  }
  bool holds = false;
  try {
    bench::Report report(options.json);
    report.note("Another process sends each sample back; @appendable and @final take turns.");
    const dds::Participant participant(domain);
    compare<bregma_wire_TrackerFrame, bregma_final_wire_TrackerFrame>(report, participant, "TrackerFrame",
                                                                      options.quick);
    compare<bregma_wire_NavigationState, bregma_final_wire_NavigationState>(report, participant, "NavigationState",
                                                                            options.quick);
    holds = report.all_hold();
  } catch (const std::exception &error) {
    std::cerr << "bench_wire: " << error.what() << "\n";
  }
  kill(echo, SIGTERM);
  waitpid(echo, nullptr, 0);
  return holds ? 0 : 1;
}
