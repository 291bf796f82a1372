// No step of a loop allocates: the engine's parts are run through a whole operation with malloc interposed.
#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "tests/component/operation_fixture.hpp"
#include "tests/support/allocation_counter.hpp"

namespace bregma::test {
namespace {

// What is published to nobody.
class Silence final : public server::ControlSink {
public:
  std::vector<wire::CommandReply> replies;
  void publish(const wire::CommandReply &reply) override { replies.push_back(reply); }
  void publish(const wire::Alarm &) override {}
  void publish(const wire::CapturedPoint &) override {}
  void log(const std::string &) override {}
  void case_changed(const casefile::Case *) override {}
};

TEST(LoopStep, NoStepOfAnyLoopAllocatesThroughAWholeOperation) {
  if (!AllocationScope::available()) {
    GTEST_SKIP() << "a sanitizer has malloc";
  }
  const CaseFolder folder;
  const TemporaryFolder state;
  server::Config config;
  config.state.directory = state.path().string();
  Silence sink;
  server::Engine engine(config, sink);
  sim::SimulatedRoom room(folder.loaded(), scenario_of(std::string(kRegisterSteps) + kNavigateSteps), kSeed);

  std::uint64_t navigation = 0;
  std::uint64_t sensors = 0;
  std::uint64_t registration = 0;
  std::uint64_t monitoring = 0;
  std::uint64_t deformation = 0;
  std::uint64_t frames = 0;
  std::uint64_t live = 0;
  const auto counted = [](std::uint64_t &total, auto &&step) {
    const AllocationScope scope;
    step();
    total += scope.count();
  };
  sim::RoomOutput out;
  constexpr std::int64_t kStep_ns = 5'000'000;
  constexpr std::int64_t kBegin_ns = 1'800'000'000'000'000'000;
  for (std::int64_t now_ns = kBegin_ns; !room.finished() && now_ns < kBegin_ns + 200'000'000'000; now_ns += kStep_ns) {
    room.advance(now_ns, out);
    for (const auto &frame : out.frames) {
      ++frames;
      counted(navigation, [&] {
        engine.receive_navigation();
        (void)engine.take(frame, 1, now_ns);
        engine.share_tracker_health(now_ns);
      });
      for (const auto &shown : engine.navigation().states()) {
        live += shown.status == bregma_wire_POSE_LIVE ? 1 : 0;
        room.on_navigation(shown, now_ns);
      }
    }
    counted(navigation, [&] { engine.tick_navigation(now_ns); });
    counted(sensors, [&] {
      for (const auto &sample : out.robot_states) {
        (void)engine.take(sample, 1, now_ns);
      }
      for (const auto &sample : out.force_samples) {
        (void)engine.take(sample, 1, now_ns);
      }
      for (const auto &sample : out.range_samples) {
        (void)engine.take(sample, 1, now_ns);
      }
      engine.share_sensor_health(now_ns);
    });
    if ((now_ns - kBegin_ns) % 100'000'000 == 0) {
      counted(registration, [&] { (void)engine.step_registration(now_ns); });
      engine.step_pose_recovery(); // no loop
      (void)engine.step_tissue_builder();
      counted(monitoring, [&] { (void)engine.step_monitoring({}, 0, now_ns); });
      counted(deformation, [&] { (void)engine.step_deformation(now_ns, 4); });
    }
    for (const auto &command : out.commands) {
      engine.session().handle(command, now_ns);
    }
    engine.poll(now_ns);
    for (const auto &reply : std::exchange(sink.replies, {})) {
      room.on_reply(reply);
    }
  }
  ASSERT_TRUE(room.finished() && !room.failed()) << room.failure();
  EXPECT_GT(frames, 10'000U);
  EXPECT_GT(live, 1'000U);
  EXPECT_EQ(navigation, 0U);
  EXPECT_EQ(sensors, 0U);
  EXPECT_EQ(registration, 0U);
  EXPECT_EQ(monitoring, 0U);
  EXPECT_EQ(deformation, 0U);
}

} // namespace
} // namespace bregma::test
