// A driver as a program: command line, invalid input, and end by a signal.
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <thread>

#include <gtest/gtest.h>
#include <unistd.h>

#include "drivers/frame/program.hpp"
#include "drivers/frame/supervisor.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/driver/fakes.hpp"

namespace bregma::driver::test {
namespace {

struct Answer {
  int code;
  std::string out, err;
};

// A device with an additional parameter.
class Sensor final : public Device {
public:
  void declare(base::ParameterSet &parameters) override {
    parameters.number("gain", &gain, "", 0.0, 10.0, "Of the amplifier");
  }
  base::Result<void> prepare(const Settings &settings) override {
    prepared = settings;
    return gain == 0.0 ? base::failure("gain = 0: the sensor would say nothing") : base::Result<void>();
  }
  Outcome<void> connect(Io &io) override { return on_connect(io); }
  Outcome<Progress> read(Io &io) override { return on_read(io); }
  void disconnect() noexcept override { ++disconnects; }

  double gain = 1.0;
  Settings prepared;
  std::function<Outcome<void>(Io &)> on_connect = [](Io &) { return Outcome<void>(); };
  std::function<Outcome<Progress>(Io &)> on_read = [](Io &) { return Outcome<Progress>(Progress::kFinished); };
  int disconnects = 0;
};

int start(Sensor &sensor, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "my-range");
  std::vector<char *> words;
  for (std::string &argument : arguments) {
    words.push_back(argument.data());
  }
  Settings defaults;
  defaults.device = "Range";
  return run_on_bus(static_cast<int>(words.size()), words.data(),
                    {"my-range", "a range sensor", "my-range --set gain=2\nmy-range --domain 7", defaults}, sensor,
                    [](std::uint32_t) { return std::make_unique<FakeBus>(); });
}

Answer ask(Sensor &sensor, const std::vector<std::string> &arguments) {
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const int code = start(sensor, arguments);
  return {code, testing::internal::GetCapturedStdout(), testing::internal::GetCapturedStderr()};
}

bool holds(const std::string &text, const std::string &part) { return text.find(part) != std::string::npos; }

TEST(Program, HelpShowsOptionsExamplesAndExitCodes) {
  Sensor sensor;
  const Answer answer = ask(sensor, {"--help"});
  EXPECT_EQ(answer.code, 0);
  for (const char *part : {"my-range, a range sensor", "--config", "--set", "--domain", "--print-config",
                           "Examples:", "  my-range --set gain=2\n", "  my-range --domain 7\n", "Exit codes: 0"}) {
    EXPECT_TRUE(holds(answer.out, part)) << part << "\n" << answer.out;
  }
}

TEST(Program, PrintsTheParametersOfFrameAndDevice) {
  Sensor sensor;
  const Answer answer = ask(sensor, {"--print-config", "--set", "gain=2.5", "--domain", "9"});
  EXPECT_EQ(answer.code, 0) << answer.err;
  EXPECT_TRUE(holds(answer.out, "gain = 2.5")) << answer.out;
  EXPECT_TRUE(holds(answer.out, "domain_id = 9")) << answer.out;
  EXPECT_TRUE(holds(answer.out, "[reconnect]")) << answer.out;
  const bregma::test::TemporaryFolder folder;
  std::ofstream(folder / "sensor.toml") << answer.out;
  Sensor other;
  const Answer again = ask(other, {"--config", (folder / "sensor.toml").string(), "--print-config"});
  EXPECT_EQ(again.out, answer.out) << again.err;
}

TEST(Program, LaterSettingsHavePrecedence) {
  const bregma::test::TemporaryFolder folder;
  std::ofstream(folder / "sensor.toml") << "gain = 3.0\ndomain_id = 1\ndevice = \"File\"\n";
  Sensor sensor;
  const Answer answer =
      ask(sensor, {"--config", (folder / "sensor.toml").string(), "--domain", "2", "--set", "gain=4"});
  EXPECT_EQ(answer.code, 0) << answer.err;
  EXPECT_EQ(sensor.gain, 4.0);
  EXPECT_EQ(sensor.prepared.domain_id, 2);
  EXPECT_EQ(sensor.prepared.device, "File");
}

TEST(Program, InvalidInputGivesATextAndExitCodeTwo) {
  const bregma::test::TemporaryFolder folder;
  std::ofstream(folder / "bad.toml") << "[reconnect]\nfirst_s = -1.0\n";
  const struct {
    std::vector<std::string> arguments;
    const char *message;
  } cases[] = {
      {{"--set", "gain=11"}, "my-range: gain = 11: must be between 0 and 10\n"},
      {{"--set", "gian=1"}, "gian = 1: unknown key"},
      {{"--set", "gain"}, "\"gain\": must be key=value"},
      {{"--set", "gain=0"}, "my-range: gain = 0: the sensor would say nothing\n"},
      {{"--set", "device="}, "device = : must be 1 to 31 bytes"},
      {{"--set", "device=A_name_that_is_longer_than_the_wire"}, "must be 1 to 31 bytes"},
      {{"--set", "reconnect.first_s=20"}, "reconnect.first_s must not be above reconnect.max_s"},
      {{"--set", "log.level=loud"}, "log.level = loud: must be"},
      {{"--domain", "231"}, "--domain"},
      {{"--config", "nowhere.toml"}, "nowhere.toml"},
      {{"--config", (folder / "bad.toml").string()}, "bad.toml:2: reconnect.first_s = -1"},
      {{"--loud"}, "--loud"},
  };
  for (const auto &bad : cases) {
    Sensor sensor;
    const Answer answer = ask(sensor, bad.arguments);
    EXPECT_EQ(answer.code, kExitBadInput) << bad.message;
    EXPECT_TRUE(holds(answer.err, bad.message)) << bad.message << "\n" << answer.err;
  }
}

TEST(Program, EndsWithTheDevice) {
  Sensor sensor;
  EXPECT_EQ(ask(sensor, {}).code, kExitDone);
  EXPECT_EQ(sensor.disconnects, 1);
  Sensor broken;
  broken.on_connect = [](Io &) -> Outcome<void> { return give_up("no license"); };
  const Answer answer = ask(broken, {});
  EXPECT_EQ(answer.code, kExitFailed);
  EXPECT_TRUE(holds(answer.err, "error my-range: no license")) << answer.err;
}

// Samples dropped between two reports are in the log.
TEST(Program, ReportsSkippedInput) {
  Sensor sensor;
  sensor.on_read = [](Io &io) {
    io.skipped(12, "wrong checksum");
    return Outcome<Progress>(Progress::kFinished);
  };
  const Answer answer = ask(sensor, {});
  EXPECT_TRUE(holds(answer.err, "dropped: 12 unreadable (last: wrong checksum)")) << answer.err;
}

// In separate processes. The device's thread sends the signal at the point that the test selects.
class Interrupted : public testing::TestWithParam<int> {
protected:
  void SetUp() override { GTEST_FLAG_SET(death_test_style, "threadsafe"); }
  static void interrupt() { (void)kill(getpid(), GetParam()); }
  // Ends with 40 instead of 0 if the device was not disconnected, and with 50 if it took longer than 1 s.
  static void expect_prompt_end(Sensor &sensor) {
    const auto begin = std::chrono::steady_clock::now();
    const int code = start(sensor, {"--set", "reconnect.first_s=60", "--set", "reconnect.max_s=60"});
    const bool late = std::chrono::steady_clock::now() - begin > std::chrono::seconds(1);
    std::_Exit(late ? 50 : sensor.disconnects == 1 ? code : 40);
  }
};

TEST_P(Interrupted, WhileItReads) {
  Sensor sensor;
  sensor.on_read = [](Io &io) {
    interrupt();
    (void)io.wait_until(io.now_ns() + 3600 * kSecond);
    return Outcome<Progress>(Progress::kContinue);
  };
  EXPECT_EXIT(expect_prompt_end(sensor), testing::ExitedWithCode(kExitDone), "");
}

TEST_P(Interrupted, WhileItConnects) {
  Sensor sensor;
  sensor.on_connect = [](Io &io) -> Outcome<void> {
    interrupt();
    (void)io.wait_until(io.now_ns() + 3600 * kSecond);
    return retry_later("interrupted");
  };
  EXPECT_EXIT(expect_prompt_end(sensor), testing::ExitedWithCode(kExitDone), "");
}

TEST_P(Interrupted, WhileItWaitsForTheNextAttempt) {
  Sensor sensor;
  sensor.on_connect = [](Io &) -> Outcome<void> {
    std::thread([] {
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
      interrupt();
    }).detach();
    return retry_later("no answer");
  };
  EXPECT_EXIT(expect_prompt_end(sensor), testing::ExitedWithCode(kExitDone), "no answer; next attempt in");
}

TEST_P(Interrupted, ADeviceThatDoesNotReturnIsAbandoned) {
  Sensor sensor;
  sensor.on_read = [](Io &) -> Outcome<Progress> {
    interrupt();
    for (;;) {
      std::this_thread::sleep_for(std::chrono::hours(1)); // a vendor's call that blocks
    }
  };
  EXPECT_EXIT((void)start(sensor, {}), testing::ExitedWithCode(kExitBlocked), "does not return");
}

INSTANTIATE_TEST_SUITE_P(Signals, Interrupted, testing::Values(SIGINT, SIGTERM),
                         [](const auto &one) { return one.param == SIGINT ? "SIGINT" : "SIGTERM"; });

} // namespace
} // namespace bregma::driver::test
