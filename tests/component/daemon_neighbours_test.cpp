// The real daemon beside others: a second daemon, a second user of its state directory, clients that flood it, and a
// log that is not read.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <memory>
#include <thread>

#include <csignal>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "server/runtime/ending.hpp"
#include "server/session/messages.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

std::vector<std::string> daemon_command(std::uint32_t domain, const std::filesystem::path &state) {
  return {BREGMA_DAEMON, "--set", "domain_id=" + std::to_string(domain), "--set", "state.directory=" + state.string()};
}

// Sends commands and waits for their replies.
class Client {
public:
  Client(std::uint32_t domain, const std::string &name)
      : participant_(domain), commands_(participant_), replies_(participant_), name_(name) {}

  [[nodiscard]] bool connected() const { return commands_.matched_readers() > 0; }
  [[nodiscard]] wire::Command command(wire::CommandKind kind, std::initializer_list<std::string_view> values) {
    wire::Command out{};
    (void)wire::set_name(out.client, name_);
    out.id = ++id_;
    out.sent_time_ns = static_cast<std::int64_t>(out.id);
    (void)wire::fill_command(out, kind, values);
    return out;
  }
  void send(const wire::Command &command) { (void)commands_.write(command); }
  // Until the reply, in seconds; empty after limit_s.
  [[nodiscard]] std::optional<double> ask(const wire::Command &command, double limit_s = 10.0) {
    const auto begin = Clock::now();
    send(command);
    while (seconds_since(begin) < limit_s) {
      bool answered = false;
      replies_.take_each([&](const wire::CommandReply &reply, const auto &) {
        if (wire::view(reply.client) == name_ && reply.id == command.id) {
          last = reply;
          answered = true;
        }
      });
      if (answered) {
        return seconds_since(begin);
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return std::nullopt;
  }

  wire::CommandReply last{};

private:
  dds::Participant participant_;
  dds::Writer<wire::Command> commands_;
  dds::Reader<wire::CommandReply> replies_;
  std::string name_;
  std::uint64_t id_ = 0;
};

// Four clients that send commands as fast as they can, for as long as it exists.
class Flood {
public:
  explicit Flood(std::uint32_t domain) {
    for (std::size_t i = 0; i < threads_.size(); ++i) {
      threads_[i] = std::thread([this, domain, i] {
        Client client(domain, "flood-" + std::to_string(i));
        while (!ended_.load() && !client.connected()) {
          std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
        while (!ended_.load()) {
          client.send(client.command(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, {"drift", "Reference"}));
          sent_[i].fetch_add(1);
        }
      });
    }
  }
  ~Flood() {
    ended_ = true;
    for (std::thread &thread : threads_) {
      thread.join();
    }
  }
  Flood(const Flood &) = delete;
  Flood &operator=(const Flood &) = delete;

  [[nodiscard]] bool begun() const {
    return std::all_of(sent_.begin(), sent_.end(), [](const auto &count) { return count.load() > 0; });
  }
  [[nodiscard]] std::uint64_t sent() const {
    std::uint64_t sum = 0;
    for (const auto &count : sent_) {
      sum += count.load();
    }
    return sum;
  }

private:
  std::atomic<bool> ended_{false};
  std::array<std::atomic<std::uint64_t>, 4> sent_{};
  std::array<std::thread, 4> threads_;
};

void start_serving(Operation &operation) {
  operation.start_daemon();
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.time_ns != 0; })) << operation.logs();
}

TEST(Neighbours, ASecondDaemonOnTheDomainRefusesToStartAndNamesTheFirst) {
  Operation operation;
  ASSERT_NO_FATAL_FAILURE(start_serving(operation));
  const TemporaryFolder other;
  Process second(daemon_command(operation.domain(), other / "state"), (other / "log").string());
  ASSERT_EQ(second.wait(20.0), 1) << second.log();
  EXPECT_NE(second.log().find("is served by another daemon (process " + std::to_string(operation.daemon().pid())),
            std::string::npos)
      << second.log();
  EXPECT_TRUE(operation.daemon().runs());
}

TEST(Neighbours, ADaemonThatRestoresASessionStartsBesideAnotherAndBothRaiseAnAlarm) {
  Operation operation;
  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  const TemporaryFolder stray_folder;
  Process stray(daemon_command(operation.domain(), stray_folder / "state"), (stray_folder / "log").string());
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.process_id != 0; }));
  operation.alarms.clear();
  const auto begin = Clock::now();
  operation.start_daemon();
  std::size_t raised = 0;
  double first_s = 0.0;
  ASSERT_TRUE(operation.observe_until([&] {
    raised = 0;
    for (const wire::Alarm &alarm : operation.alarms) {
      const bool other = wire::view(alarm.kind) == server::alarm::kOtherDaemon &&
                         alarm.state == bregma_wire_ALARM_RAISED && alarm.severity == bregma_wire_SEVERITY_CRITICAL;
      raised += other ? 1 : 0;
    }
    first_s = raised == 1 && first_s == 0.0 ? seconds_since(begin) : first_s;
    return raised >= 2;
  })) << operation.logs()
      << stray.log();
  std::printf("Both daemons raised the alarm; the first %.2f s after the second was started\n", first_s);
  EXPECT_TRUE(stray.runs());
  EXPECT_TRUE(operation.daemon().runs());
  stray.signal(SIGTERM);
  EXPECT_EQ(stray.wait(5.0), 0);
}

TEST(Neighbours, ASecondUserOfTheStateDirectoryIsRefusedAndTheFirstRaisesAnAlarm) {
  Operation operation;
  ASSERT_NO_FATAL_FAILURE(start_serving(operation));
  const TemporaryFolder other;
  const auto begin = Clock::now();
  Process second(daemon_command(operation.domain() + 100, operation.state_folder()), (other / "log").string());
  ASSERT_EQ(second.wait(20.0), 1) << second.log();
  EXPECT_NE(second.log().find("is in use by another bregmad (process " + std::to_string(operation.daemon().pid())),
            std::string::npos)
      << second.log();
  ASSERT_TRUE(operation.observe_until([&] { return operation.alarm_raised(server::alarm::kStateUser); }))
      << operation.logs();
  std::printf("The alarm was raised %.2f s after the second daemon was started\n", seconds_since(begin));
}

TEST(Neighbours, ALogThatIsNotReadDelaysNothing) {
  Operation operation;
  const TemporaryFolder folder;
  const std::string pipe = (folder / "stderr").string();
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const int held = open(pipe.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  ASSERT_GE(held, 0);
  const std::array<char, 4096> filler{};
  while (write(held, filler.data(), filler.size()) > 0) { // until it is full
  }
  std::vector<std::string> command{"/bin/sh", "-c", "exec 2>\"$0\" \"$@\"", pipe};
  for (const std::string &word : daemon_command(operation.domain(), folder / "state")) {
    command.push_back(word);
  }
  Process daemon(command, (folder / "log").string());
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.time_ns != 0; }));
  Client client(operation.domain(), "surgeon");
  ASSERT_TRUE(operation.observe_until([&] { return client.connected(); }));
  double longest_s = 0.0;
  for (int i = 0; i < 50; ++i) {
    const auto taken = client.ask(client.command(bregma_wire_COMMAND_LOAD_CASE, {"/no/such/case"}));
    ASSERT_TRUE(taken);
    longest_s = std::max(longest_s, *taken);
  }
  const auto begin = Clock::now();
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(10.0), 0);
  std::printf("Longest reply %.0f ms, end after SIGTERM %.2f s\n", 1e3 * longest_s, seconds_since(begin));
  if (!kSanitized) {
    EXPECT_LT(seconds_since(begin), 2.0);
  }
  close(held);
}

TEST(Neighbours, AFloodOfCommandsDelaysNoReplyOfOthersAndLosesNoRecord) {
  Operation operation;
  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  operation.start_daemon();
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.session == bregma_wire_SESSION_REGISTERED; }))
      << operation.logs();
  Client client(operation.domain(), "surgeon");
  ASSERT_TRUE(operation.observe_until([&] { return client.connected(); }));

  auto flood = std::make_unique<Flood>(operation.domain());
  ASSERT_TRUE(operation.observe_until([&] { return flood->begun(); }));
  const std::uint64_t sent_before = flood->sent();
  double longest_s = 0.0;
  const auto begin = Clock::now();
  for (int i = 0; i < 50; ++i) {
    const auto taken = client.ask(client.command(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, {"drift", "Reference"}));
    ASSERT_TRUE(taken) << "no reply under the flood\n" << operation.logs();
    longest_s = std::max(longest_s, *taken);
    operation.observe_for(0.1);
  }
  const double rate_hz = static_cast<double>(flood->sent() - sent_before) / seconds_since(begin);
  flood.reset();
  EXPECT_TRUE(operation.alarm_raised(server::alarm::kCommandFlood)) << rate_hz << " commands/s\n" << operation.logs();
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.refused_commands > 0; }));
  std::printf("%.0f commands/s, longest reply of another client %.0f ms, %llu records dropped, %llu commands refused\n",
              rate_hz, 1e3 * longest_s, static_cast<unsigned long long>(operation.health.record_dropped),
              static_cast<unsigned long long>(operation.health.refused_commands));
  EXPECT_EQ(operation.health.record_dropped, 0U);
  if (!kSanitized) {
    EXPECT_LT(longest_s, 1.0);
  }
}

TEST(Neighbours, ADiskThatHangsDelaysOnlyWhatMustBeOnIt) {
  Operation operation;
  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  const std::filesystem::path flag = operation.state_folder() / "slow";
  // A sanitizer's library would have to come before the preloaded one; it need not here.
  operation.start_daemon({},
                         {"/usr/bin/env", "ASAN_OPTIONS=verify_asan_link_order=0",
                          std::string("LD_PRELOAD=") + BREGMA_SLOW_DISK_LIBRARY, "BREGMA_SLOW_DISK=" + flag.string()});
  operation.start_room("[[steps]]\ndo = \"wait\"\nduration_s = 60.0\n");
  ASSERT_TRUE(operation.observe_until([&] {
    return operation.health.session == bregma_wire_SESSION_REGISTERED && operation.device("Tracker") != nullptr &&
           operation.device("Tracker")->status == bregma_wire_DEVICE_LIVE;
  })) << operation.logs();
  Client client(operation.domain(), "surgeon");
  ASSERT_TRUE(operation.observe_until([&] { return client.connected(); }));

  std::ofstream(flag) << "on\n";
  const auto began = Clock::now();
  client.send(client.command(bregma_wire_COMMAND_START_REGISTRATION, {})); // its reply waits for the disk
  double longest_s = 0.0;
  const auto ask = [&] {
    const auto taken = client.ask(client.command(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, {"drift", "Reference"}));
    ASSERT_TRUE(taken) << operation.logs();
    longest_s = std::max(longest_s, *taken);
  };
  for (int i = 0; i < 20; ++i) {
    ASSERT_NO_FATAL_FAILURE(ask());
    operation.observe_for(0.05);
  }
  operation.alarms.clear();
  const auto lost = Clock::now();
  operation.room().signal(SIGKILL);
  ASSERT_TRUE(operation.observe_until([&] { return operation.alarm_raised(server::alarm::kTrackerLost); }))
      << operation.logs();
  const double alarm_s = seconds_since(lost);
  EXPECT_LT(seconds_since(began), 5.0) << "the disk was not slow for the whole test";
  const auto ending = Clock::now();
  operation.daemon().signal(SIGTERM);
  const auto status = operation.daemon().wait(10.0);
  const double end_s = seconds_since(ending);
  std::printf(
      "Longest reply without a change %.0f ms, alarm %.2f s after the loss, end %.2f s after SIGTERM, status %d\n",
      1e3 * longest_s, alarm_s, end_s, status.value_or(-1));
  if (!kSanitized) {
    EXPECT_LT(longest_s, 0.5);
    EXPECT_LT(alarm_s, 1.0);
    EXPECT_LT(end_s, 2.0);
  }
  EXPECT_EQ(status, runtime::kEndedByLimit) << "the snapshot was not on disk yet";
}

} // namespace
} // namespace bregma::test
