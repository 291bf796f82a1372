// The coil controller: lines, time-out to off, and commands through the device over a pseudo-terminal.
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <thread>
#include <vector>

#include "casefile/coil_frames.hpp"
#include "drivers/coils/coil_controller.hpp"
#include "drivers/frame/system_host.hpp"
#include "drivers/sim/coils/simulated_controller.hpp"
#include "drivers/sim/terminal/pseudo_terminal.hpp"
#include "idl/commands.hpp"

namespace bregma::coils::test {

namespace {

mri::CoilFrame frame() {
  mri::CoilFrame out;
  out.name = "small";
  out.coils = {{"t1", "top", {-50, -45, 30}},
               {"t2", "top", {52, -40, 22}},
               {"b1", "bottom", {-46, 20, -30}},
               {"b2", "bottom", {10, -52, -36}}};
  return out;
}

// Commands for the device, and its replies.
class CommandBus final : public driver::Bus {
public:
  bool write(std::string_view topic, const void *sample) override {
    if (topic == wire::Topic<wire::CommandReply>::kName) {
      replies.push_back(*static_cast<const wire::CommandReply *>(sample));
    }
    return true;
  }
  void take(std::string_view topic, const std::function<void(const void *)> &visit) override {
    if (topic == wire::Topic<wire::Command>::kName) {
      for (const wire::Command &c : std::exchange(commands, {})) {
        visit(&c);
      }
    }
  }
  [[nodiscard]] std::uint32_t matched(std::string_view /*topic*/) const override { return 1; }

  std::vector<wire::Command> commands;
  std::vector<wire::CommandReply> replies;
};

// A simulated controller behind a pseudo-terminal, answered by a thread.
class Terminal {
public:
  explicit Terminal(const sim::CoilFaults &faults)
      : controller_(faults, 3), terminal_(sim::PseudoTerminal::open().value()) {
    address = terminal_.address();
    thread_ = std::thread([this] { serve(); });
  }
  ~Terminal() {
    stop_ = true;
    thread_.join();
  }
  Terminal(const Terminal &) = delete;
  Terminal &operator=(const Terminal &) = delete;

  std::string address;
  std::atomic<std::uint64_t> on{0};
  std::atomic<bool> silent{false};
  std::atomic<bool> resets{false}; // switches off by itself

private:
  void serve() {
    const auto start = std::chrono::steady_clock::now();
    while (!stop_) {
      const std::string bytes = terminal_.read(std::chrono::milliseconds(5));
      const std::int64_t now_ms =
          std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::steady_clock::now() - start).count();
      if (resets.exchange(false)) {
        (void)controller_.receive(line_of(Order{Order::Kind::kOff}), now_ms);
      }
      const std::string answer = controller_.receive(bytes, now_ms);
      if (!silent) {
        terminal_.write(answer);
      }
      controller_.advance(now_ms);
      on = controller_.on();
    }
  }

  sim::SimulatedController controller_;
  sim::PseudoTerminal terminal_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

class Controller : public testing::Test {
protected:
  void start(const sim::CoilFaults &faults = {}) {
    terminal = std::make_unique<Terminal>(faults);
    const std::string file = testing::TempDir() + "/coil_frame_" + std::to_string(getpid()) + ".toml";
    std::ofstream(file) << casefile::coil_frame_text(frame());
    base::ParameterSet parameters("bregma-coils");
    device.declare(parameters);
    ASSERT_TRUE(parameters.set_from_string("address=" + terminal->address));
    ASSERT_TRUE(parameters.set_from_string("frame=" + file));
    driver::Settings settings;
    settings.device = "Coils";
    const auto prepared = device.prepare(settings);
    ASSERT_TRUE(prepared) << prepared.error().message;
    ASSERT_TRUE(device.connect(io));
  }

  wire::CommandReply send(const char *pattern, const char *current_mA, const char *hold_s,
                          const char *receiver = "Coils") {
    wire::Command command{};
    const std::string wrong =
        wire::fill_command(command, bregma_wire_COMMAND_SET_COILS, {"Coils", pattern, current_mA, hold_s});
    EXPECT_EQ(wrong, "");
    EXPECT_TRUE(wire::set_name(command.receiver, receiver));
    command.id = ++id;
    bus.commands.push_back(command);
    const std::size_t before = bus.replies.size();
    for (int i = 0; i < 200 && bus.replies.size() == before; ++i) {
      const auto progress = device.read(io);
      EXPECT_TRUE(progress) << progress.error().message;
      if (!progress) {
        break;
      }
    }
    if (bus.replies.size() == before) {
      return {};
    }
    EXPECT_EQ(bus.replies.back().id, id);
    return bus.replies.back();
  }

  void run_ms(int ms) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(ms);
    while (std::chrono::steady_clock::now() < end) {
      ASSERT_TRUE(device.read(io));
    }
  }

  std::unique_ptr<Terminal> terminal;
  CommandBus bus;
  driver::SystemHost host;
  driver::Status status;
  driver::Io io{bus, host, status, {.device = "Coils"}};
  CoilController device;
  std::uint64_t id = 0;
};

} // namespace

TEST(CoilLine, OrdersAndStatesReadBack) {
  for (const Order &order : {Order{Order::Kind::kSet, 0xF0000000000000F1U, -75000, 60000}, Order{Order::Kind::kOff},
                             Order{Order::Kind::kGet}}) {
    const std::string line = line_of(order);
    ASSERT_TRUE(line.ends_with("\r\n"));
    const auto read = parse_order(std::string_view(line).substr(0, line.size() - 2));
    ASSERT_TRUE(read) << line;
    EXPECT_EQ(read->kind, order.kind);
    EXPECT_EQ(read->coils, order.coils);
    EXPECT_EQ(read->current_uA, order.current_uA);
    EXPECT_EQ(read->hold_ms, order.hold_ms);
  }
  const State state{7, 0x1F, -75000, 1234, 74000, 76000, 0x10};
  const std::string line = line_of(state);
  const auto read = parse_state(std::string_view(line).substr(0, line.size() - 2));
  ASSERT_TRUE(read) << line;
  EXPECT_EQ(line_of(*read), line);
}

TEST(CoilLine, DamagedLinesAreRefusedByProblem) {
  EXPECT_EQ(parse_state("$STA,7,1F,75000,1,74000,76000,0*00").error(), "wrong checksum");
  EXPECT_EQ(parse_state("hello").error(), "not a message of a coil controller");
  EXPECT_EQ(parse_state(std::string(200, 'x')).error(), "line too long");
  const auto with_sum = [](const std::string &body) {
    unsigned sum = 0;
    for (const char c : body) {
      sum ^= static_cast<unsigned char>(c);
    }
    char end[8];
    std::snprintf(end, sizeof end, "*%02X", sum);
    return "$" + body + end;
  };
  EXPECT_EQ(parse_state(with_sum("STA,7,1,75000,1,74000")).error(), "not a state");
  EXPECT_EQ(parse_state(with_sum("STA,7,1,75000,1,76000,74000,0")).error(), "a value of the state is out of range");
  EXPECT_EQ(parse_state(with_sum("STA,7,1,75000,1,74000,76000,2")).error(), "a value of the state is out of range");
  EXPECT_EQ(parse_order(with_sum("SET,1,75000,-1")).error(), "current or hold out of range");
  EXPECT_EQ(parse_order(with_sum("SET,1,2000000,10")).error(), "current or hold out of range");
  EXPECT_EQ(parse_order(with_sum("ON")).error(), "unknown order");
}

TEST(SimulatedController, SwitchesOffByItself) {
  sim::SimulatedController controller({}, 1);
  (void)controller.receive(line_of(Order{Order::Kind::kSet, 0x3, 75000, 500}), 1000);
  EXPECT_EQ(controller.on(), 0x3U);
  controller.advance(1499);
  EXPECT_EQ(controller.on(), 0x3U);
  controller.advance(1500);
  EXPECT_EQ(controller.on(), 0U);
}

TEST(Patterns, AreGroupsAndCoilsJoined) {
  const mri::CoilFrame f = frame();
  EXPECT_EQ(*casefile::coils_of(f, "background"), 0U);
  EXPECT_EQ(*casefile::coils_of(f, "top"), 0x3U);
  EXPECT_EQ(*casefile::coils_of(f, "top+b2"), 0xBU);
  EXPECT_EQ(casefile::coils_of(f, "top+middle").error(), "\"middle\" is no coil and no group of the frame small");
  EXPECT_FALSE(casefile::coils_of(f, ""));
  EXPECT_FALSE(casefile::coils_of(f, "top+"));
}

TEST_F(Controller, SetsCoilsAndConfirmsTheMeasuredCurrent) {
  start();
  const auto done = send("top", "75", "60");
  EXPECT_EQ(done.result, bregma_wire_COMMAND_DONE) << done.text;
  EXPECT_EQ(std::string(done.text).rfind("t1, t2 on, 7", 0), 0U) << done.text;
  run_ms(50);
  EXPECT_EQ(terminal->on, 0x3U);
  EXPECT_EQ(send("bottom", "-75", "60").result, bregma_wire_COMMAND_DONE);
  run_ms(50);
  EXPECT_EQ(terminal->on, 0xCU);
  const auto off = send("background", "0", "0");
  EXPECT_EQ(off.result, bregma_wire_COMMAND_DONE);
  EXPECT_STREQ(off.text, "all coils off");
  run_ms(50);
  EXPECT_EQ(terminal->on, 0U);
}

TEST_F(Controller, RefusesWhatItMustNotDoAndLeavesTheCoils) {
  start();
  EXPECT_STREQ(send("top", "76", "60").text, "current_mA = 76.0 mA: must not be 0 and at most 75.0 mA");
  EXPECT_STREQ(send("side", "75", "60").text, "\"side\" is no coil and no group of the frame small");
  EXPECT_EQ(send("top", "75", "0").result, bregma_wire_COMMAND_REFUSED);
  EXPECT_EQ(send("top", "75", "99999").result, bregma_wire_COMMAND_REFUSED);
  run_ms(50);
  EXPECT_EQ(terminal->on, 0U);
  // A command for another device gets no reply from this one.
  wire::Command other{};
  ASSERT_EQ(wire::fill_command(other, bregma_wire_COMMAND_SET_COILS, {"Coils", "top", "75", "60"}), "");
  ASSERT_TRUE(wire::set_name(other.receiver, "OtherCoils"));
  const std::size_t before = bus.replies.size();
  bus.commands.push_back(other);
  run_ms(100);
  EXPECT_EQ(bus.replies.size(), before);
}

TEST_F(Controller, AnOpenCableIsNamed) {
  start({.open = 0xE});
  const auto reply = send("top", "75", "60");
  EXPECT_EQ(reply.result, bregma_wire_COMMAND_DONE) << "the other coil is on";
  EXPECT_EQ(std::string(reply.text).rfind("no current in t2: check the cables; t1 on, 7", 0), 0U) << reply.text;
  run_ms(50);
  EXPECT_EQ(terminal->on, 0x1U);
  const auto none = send("bottom", "75", "60");
  EXPECT_EQ(none.result, bregma_wire_COMMAND_REFUSED);
  EXPECT_STREQ(none.text, "no current in b1, b2: check the cables");
}

TEST_F(Controller, AnOrderOfBeforeTheConnectionSwitchesNothingOn) {
  start();
  device.disconnect();
  for (const char *pattern : {"top", "background"}) {
    wire::Command &command = bus.commands.emplace_back();
    ASSERT_EQ(wire::fill_command(command, bregma_wire_COMMAND_SET_COILS, {"Coils", pattern, "75", "60"}), "");
    ASSERT_TRUE(wire::set_name(command.receiver, "Coils"));
    command.id = ++id;
  }
  ASSERT_TRUE(device.connect(io));
  run_ms(200);
  EXPECT_EQ(terminal->on, 0U);
  ASSERT_EQ(bus.replies.size(), 2U);
  EXPECT_EQ(bus.replies[0].result, bregma_wire_COMMAND_REFUSED);
  EXPECT_STREQ(bus.replies[0].text, "the controller was not connected when the order came: order again");
  EXPECT_EQ(bus.replies[1].result, bregma_wire_COMMAND_DONE) << "off is always carried out";
}

TEST_F(Controller, ACurrentThatIsNotReachedIsNotConfirmed) {
  start({.gain = 0.8});
  const auto reply = send("top", "75", "60");
  EXPECT_EQ(reply.result, bregma_wire_COMMAND_REFUSED);
  EXPECT_NE(std::string(reply.text).find("instead of 75.0 mA"), std::string::npos) << reply.text;
}

TEST_F(Controller, TheHoldEndsAndDisconnectingSwitchesOff) {
  start();
  ASSERT_EQ(send("top", "75", "0.3").result, bregma_wire_COMMAND_DONE);
  run_ms(500);
  EXPECT_EQ(terminal->on, 0U);
  ASSERT_EQ(send("top", "75", "60").result, bregma_wire_COMMAND_DONE);
  run_ms(50);
  ASSERT_EQ(terminal->on, 0x3U);
  device.disconnect();
  for (int i = 0; i < 100 && terminal->on != 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_EQ(terminal->on, 0U);
}

TEST_F(Controller, CoilsThatGoOffBeforeTheHoldHasRunOutAreAFailure) {
  start();
  ASSERT_EQ(send("top", "75", "60").result, bregma_wire_COMMAND_DONE);
  run_ms(300);
  terminal->resets = true;
  driver::Outcome<driver::Progress> progress = driver::Progress::kContinue;
  for (int i = 0; i < 500 && progress; ++i) {
    progress = device.read(io);
  }
  ASSERT_FALSE(progress);
  EXPECT_EQ(progress.error().message, terminal->address + ": the controller has switched the coils by itself");
}

TEST_F(Controller, ASilentControllerIsAFailure) {
  start();
  terminal->silent = true;
  driver::Outcome<driver::Progress> progress = driver::Progress::kContinue;
  for (int i = 0; i < 500 && progress; ++i) {
    progress = device.read(io);
  }
  ASSERT_FALSE(progress);
  EXPECT_EQ(progress.error().message, terminal->address + ": the controller does not answer");
  EXPECT_FALSE(progress.error().permanent);
}

} // namespace bregma::coils::test
