// Minutes of navigation at the full rate, with daemon and room as processes: every lost sample must be counted, and
// memory must not grow. BREGMA_SOAK_MINUTES sets the duration (default: 10).
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numeric>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "casefile/session_file/session_file.hpp"
#include "idl/names.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

constexpr double kSetUp_s = 60.0; // check touches and the path to the target; memory use settles meanwhile

double minutes_asked_for() {
  const char *text = std::getenv("BREGMA_SOAK_MINUTES");
  return text == nullptr ? 10.0 : std::max(0.1, std::atof(text));
}

// The room's final report: written samples per device.
std::map<std::string, nlohmann::json> sent_by_room(const std::string &log) {
  std::map<std::string, nlohmann::json> out;
  std::istringstream lines(log);
  for (std::string line; std::getline(lines, line);) {
    const auto json = nlohmann::json::parse(line, nullptr, false);
    if (json.is_object() && json.value("event", "") == "sent") {
      out[json.at("device").get<std::string>()] = json;
    }
  }
  return out;
}

// Scenario of a navigation for this time, with lost frames, faulty samples and copies.
std::string scenario(double seconds) {
  std::string text = std::string("[tracker]\nmissing_share = 0.01\n") + kNavigateSteps;
  const std::string short_hold = "duration_s = 60.0";
  text.replace(text.find(short_hold), short_hold.size(), "duration_s = " + std::to_string(seconds));
  int at_s = 10;
  for (const char *sample : {"not_finite", "not_a_rotation", "time_backwards", "duplicate", "unknown_tool"}) {
    text += "[[faults]]\nkind = \"bad_samples\"\nafter_s = " + std::to_string(at_s++) + ".0\nsample = \"" + sample +
            "\"\ncount = 7\n";
  }
  return text;
}

struct MemoryAt {
  double at_s;
  double mebibytes;
};

// Growth from the first quarter after the first minute to the last quarter.
double growth_mebibytes(const std::vector<MemoryAt> &memory) {
  std::vector<double> settled;
  for (const MemoryAt &m : memory) {
    if (m.at_s >= 60.0) {
      settled.push_back(m.mebibytes);
    }
  }
  const auto quarter = static_cast<std::ptrdiff_t>(settled.size() / 4);
  if (quarter == 0) {
    return 0.0;
  }
  const double first = std::accumulate(settled.begin(), settled.begin() + quarter, 0.0);
  const double last = std::accumulate(settled.end() - quarter, settled.end(), 0.0);
  return (last - first) / static_cast<double>(quarter);
}

// Content of the run's session files.
struct Recorded {
  std::uint64_t frames = 0;
  std::uint64_t states = 0;
  std::map<std::string, std::uint64_t> first_number, last_number; // per device
};

template <class Sample> std::uint64_t read_stream(const casefile::SessionReader &reader, Recorded &recorded) {
  const auto count = reader.each<Sample>([&](const Sample &sample, std::int64_t) {
    const std::string device(wire::view(sample.device));
    recorded.first_number.try_emplace(device, sample.frame);
    recorded.last_number[device] = std::max(recorded.last_number[device], sample.frame);
  });
  EXPECT_TRUE(count) << count.error().message;
  return count.value_or(0);
}

Recorded read_sessions(const std::filesystem::path &folder) {
  Recorded out;
  for (const auto &entry : std::filesystem::directory_iterator(folder)) {
    const auto reader = casefile::SessionReader::open(entry.path());
    if (!reader) {
      ADD_FAILURE() << reader.error().message;
      continue;
    }
    out.frames += read_stream<wire::TrackerFrame>(*reader, out);
    read_stream<wire::RobotState>(*reader, out);
    read_stream<wire::ForceSample>(*reader, out);
    read_stream<wire::RangeSample>(*reader, out);
    out.states += reader->each<wire::NavigationState>([](const auto &, std::int64_t) {}).value_or(0);
  }
  return out;
}

TEST(Soak, EverySampleIsCountedAndMemoryIsConstant) {
  const double seconds = 60.0 * minutes_asked_for();
  Operation operation;
  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  operation.start_daemon();
  // The recording begins with the restored case, which is loaded beside the loops.
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.session == bregma_wire_SESSION_REGISTERED; }))
      << operation.logs();
  operation.start_room(scenario(seconds), {"--json"});

  std::vector<MemoryAt> memory;
  std::size_t states = 0;
  const auto observe = [&] {
    if (operation.health.time_ns == 0) {
      return;
    }
    const double at_s = 1e-9 * static_cast<double>(operation.health.time_ns - operation.health.started_time_ns);
    if (memory.empty() || at_s - memory.back().at_s >= 1.0) {
      memory.push_back({at_s, static_cast<double>(operation.health.resident_bytes) / 1048576.0});
    }
    states += operation.probe.size();
    operation.probe.clear();
  };
  ASSERT_TRUE(operation.observe_until(
      [&] {
        observe();
        return !operation.room().runs();
      },
      seconds + 2.0 * kSetUp_s))
      << operation.logs();
  ASSERT_EQ(operation.room().wait(0.0), 0) << operation.logs();
  const auto since = operation.health.time_ns;
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.time_ns > since + 2'000'000'000; }));
  const wire::SystemHealth health = operation.health;
  operation.daemon().signal(SIGTERM);
  ASSERT_EQ(operation.daemon().wait(30.0), 0) << operation.logs();

  const auto sent = sent_by_room(operation.room().log());
  ASSERT_EQ(sent.size(), 4U) << operation.room().log();
  const Recorded recorded = read_sessions(operation.case_folder().loaded().folder / "sessions");
  std::uint64_t frames_arrived = 0;
  std::printf("%-8s %10s %10s %10s %10s %10s %10s\n", "device", "written", "numbered", "taken", "rejected", "lost",
              "in transit");
  for (std::uint32_t i = 0; i < health.device_count; ++i) {
    const wire::DeviceHealth &device = health.devices[i];
    const std::string name(wire::view(device.device));
    ASSERT_TRUE(sent.contains(name)) << name;
    const auto written = sent.at(name).at("written").get<std::uint64_t>();
    const auto numbered = sent.at(name).at("last_number").get<std::uint64_t>();
    const std::uint64_t rejected =
        std::accumulate(std::begin(device.rejected), std::end(device.rejected), std::uint64_t{0});
    const std::uint64_t copies = device.rejected[bregma_wire_REJECT_DUPLICATE];
    const std::uint64_t on_the_way = written - (device.taken + rejected);
    std::printf("%-8s %10llu %10llu %10llu %10llu %10llu %10lld\n", name.c_str(),
                static_cast<unsigned long long>(written), static_cast<unsigned long long>(numbered),
                static_cast<unsigned long long>(device.taken), static_cast<unsigned long long>(rejected),
                static_cast<unsigned long long>(device.lost), static_cast<long long>(on_the_way));
    // From the first received sample to the last, every number of the device is accepted, rejected or lost. (A copy has
    // no separate number.) A device that ends may lose its last sample on the way, which no later number shows.
    ASSERT_TRUE(recorded.first_number.contains(name)) << name;
    const std::uint64_t before_joining = recorded.first_number.at(name) - 1;
    const std::uint64_t last = recorded.last_number.at(name);
    EXPECT_EQ(before_joining + device.taken + rejected - copies + device.lost, last) << name;
    EXPECT_LE(numbered - last, 2U) << name;
    EXPECT_LT(before_joining, numbered / 20) << name << ": the daemon joined late";
    // Samples that were written but not received are counted as lost, or were written before the daemon joined.
    EXPECT_LE(on_the_way, before_joining + device.lost + (numbered - last)) << name;
    frames_arrived += device.kind == bregma_wire_DEVICE_TRACKER ? device.taken + rejected : 0;
  }
  EXPECT_EQ(health.device_count, 4U);

  // All received samples are in the session file.
  EXPECT_EQ(health.record_dropped, 0U);
  EXPECT_EQ(recorded.frames, frames_arrived);

  const double growth = growth_mebibytes(memory);
  std::printf("%.0f s; %zu states of the probe seen, %llu states recorded; resident %.1f MiB, growth after the first "
              "minute %+.2f MiB; seed %llu\n",
              seconds, states, static_cast<unsigned long long>(recorded.states), memory.back().mebibytes, growth,
              static_cast<unsigned long long>(kSeed));
  for (std::uint32_t i = 0; i < health.loop_count; ++i) {
    const wire::LoopHealth &loop = health.loops[i];
    std::printf("  loop %-14s %10llu steps, %llu overruns\n", std::string(wire::view(loop.loop)).c_str(),
                static_cast<unsigned long long>(loop.steps), static_cast<unsigned long long>(loop.overruns));
  }
  EXPECT_LT(growth, 1.0) << "MiB after the first minute";
}

} // namespace
} // namespace bregma::test
