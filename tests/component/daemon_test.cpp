// The real daemon and the simulated room as processes over DDS, and failures of either.
#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <thread>

#include <csignal>
#include <gtest/gtest.h>

#include "casefile/session_file/session_file.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "server/session/messages.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true; // several times slower: waiting times are not tested
#else
constexpr bool kSanitized = false;
#endif

template <std::size_t Size> std::array<std::uint64_t, Size> bits_of(const double (&numbers)[Size]) {
  std::array<std::uint64_t, Size> out;
  std::transform(std::begin(numbers), std::end(numbers), out.begin(),
                 [](double number) { return std::bit_cast<std::uint64_t>(number); });
  return out;
}

bool is_shown(const wire::NavigationState &state) {
  return state.status == bregma_wire_POSE_LIVE || state.status == bregma_wire_POSE_UNVERIFIED;
}

constexpr std::int64_t kLiveLimit_ns = 100'000'000; // at 250 Hz

// Conditions on every published state.
void expect_no_pose_that_is_not_live(const std::vector<wire::NavigationState> &states) {
  for (const wire::NavigationState &state : states) {
    if (is_shown(state)) {
      ASSERT_TRUE(std::isfinite(state.T_image_tip.translation_mm[0]));
      ASSERT_LT(state.published_time_ns - state.acquired_time_ns, kLiveLimit_ns)
          << "frame " << state.frame << " was shown although it was stale";
      ASSERT_EQ(state.valid_for_ns, kLiveLimit_ns - state.age_ns);
      ASSERT_TRUE(std::isfinite(state.velocity_covariance_mm2_s2[8])) << "the growth of the error is stated";
    } else {
      ASSERT_TRUE(std::isnan(state.T_image_tip.translation_mm[0])) << "status " << state.status;
      ASSERT_TRUE(std::isnan(state.T_image_tip.rotation_wxyz[0]));
      ASSERT_TRUE(std::isnan(state.distance_to_target_mm));
    }
  }
}

std::size_t count(const std::vector<wire::NavigationState> &states, wire::PoseStatus status) {
  return static_cast<std::size_t>(
      std::count_if(states.begin(), states.end(), [status](const auto &state) { return state.status == status; }));
}

// Registers in virtual time, then runs daemon and room as processes until the probe is navigated.
void start_navigating(Operation &operation) {
  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  operation.start_daemon();
  operation.start_room(kNavigateSteps);
  ASSERT_TRUE(operation.observe_until([&] { return operation.probe_is(bregma_wire_POSE_LIVE); }, 90.0))
      << operation.logs();
}

TEST(Daemon, AStoppedKilledAndRestartedTrackerIsNeverShownAsLiveAndRecoversAutomatically) {
  Operation operation;
  ASSERT_NO_FATAL_FAILURE(start_navigating(operation));
  operation.observe_for(1.0);
  for (const wire::NavigationState &state : operation.probe) {
    const bool has_frame = state.acquired_time_ns > 0;
    EXPECT_EQ(wire::view(state.source), has_frame ? "Tracker" : "");
    EXPECT_EQ(state.source_kind, has_frame ? bregma_wire_DEVICE_TRACKER : bregma_wire_DEVICE_UNKNOWN);
    EXPECT_GT(state.published_boot_ns, 0);
    EXPECT_TRUE(std::any_of(std::begin(state.boot_id), std::end(state.boot_id), [](auto byte) { return byte != 0; }));
  }

  operation.room().signal(SIGSTOP);
  ASSERT_TRUE(operation.observe_until([&] { return operation.probe_is(bregma_wire_POSE_LOST); })) << operation.logs();
  EXPECT_GE(count(operation.probe, bregma_wire_POSE_STALE), 1U) << "a silent tracker is stale before it is lost";
  // The first states after the last live one: stale at the limit, lost after the deadline.
  const auto last_live =
      std::find_if(operation.probe.rbegin(), operation.probe.rend(), [](const auto &state) { return is_shown(state); });
  ASSERT_NE(last_live, operation.probe.rend());
  for (auto state = last_live.base(); state != operation.probe.end(); ++state) {
    const std::int64_t silent_ns = state->published_time_ns - state->acquired_time_ns - 4'000'000;
    EXPECT_EQ(state->status,
              silent_ns < wire::qos::kTracker.deadline_ns ? bregma_wire_POSE_STALE : bregma_wire_POSE_LOST)
        << silent_ns << " ns";
  }
  ASSERT_TRUE(operation.observe_until([&] { return operation.alarm_raised(server::alarm::kTrackerLost); }))
      << operation.logs();
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.session == bregma_wire_SESSION_DEGRADED; }))
      << operation.logs();
  operation.room().signal(SIGKILL);
  const std::size_t shown_before = operation.probe.size();
  operation.observe_for(1.5);
  for (std::size_t i = shown_before; i < operation.probe.size(); ++i) {
    ASSERT_FALSE(is_shown(operation.probe[i])) << "a pose was shown while there was no tracker";
  }

  // The same patient in the same room: the driver is restarted without a message to the daemon.
  operation.probe.clear();
  operation.start_room(R"(
[[steps]]
do = "follow_trajectory"
tool = "Probe"
trajectory = "Biopsy"
duration_s = 60.0
)");
  ASSERT_TRUE(operation.observe_until([&] { return operation.probe_is(bregma_wire_POSE_LIVE); }, 90.0))
      << operation.logs();
  ASSERT_TRUE(operation.observe_until([&] {
    return operation.health.session == bregma_wire_SESSION_NAVIGATING && operation.device("Tracker") != nullptr &&
           operation.device("Tracker")->connections == 2;
  })) << operation.logs();
  expect_no_pose_that_is_not_live(operation.probe);
}

TEST(Daemon, KilledDuringNavigationRestartsAsRegisteredWithTheSameRegistration) {
  Operation operation;
  ASSERT_NO_FATAL_FAILURE(start_navigating(operation));
  ASSERT_TRUE(operation.observe_until([&] { return operation.registration.accepted_revision != 0; }));
  const wire::RegistrationState before = operation.registration;

  operation.daemon().signal(SIGKILL);
  ASSERT_EQ(operation.daemon().wait(10.0), 128 + SIGKILL);
  operation.observe_for(0.2);
  operation.registration = {};
  operation.health = {};
  operation.probe.clear();
  const auto began = std::chrono::steady_clock::now();
  operation.start_daemon();
  ASSERT_TRUE(operation.observe_until([&] {
    return operation.registration.accepted_revision != 0 && operation.health.session == bregma_wire_SESSION_REGISTERED;
  })) << operation.logs();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  RecordProperty("seconds_to_registered", std::to_string(seconds));
  std::printf("Registered again after %.2f s\n", seconds);
  if (!kSanitized) {
    EXPECT_LT(seconds, 2.0);
  }
  EXPECT_EQ(operation.registration.accepted_revision, before.accepted_revision);
  const auto &pose = operation.registration.accepted_T_image_reference;
  EXPECT_EQ(bits_of(pose.rotation_wxyz), bits_of(before.accepted_T_image_reference.rotation_wxyz));
  EXPECT_EQ(bits_of(pose.translation_mm), bits_of(before.accepted_T_image_reference.translation_mm));
  EXPECT_EQ(bits_of(operation.registration.accepted_covariance), bits_of(before.accepted_covariance));
  // It asks for verification: poses are computed for check touches, but none is live.
  ASSERT_TRUE(operation.observe_until([&] { return operation.probe_is(bregma_wire_POSE_UNVERIFIED); }))
      << operation.logs();
  EXPECT_EQ(count(operation.probe, bregma_wire_POSE_LIVE), 0U);
}

TEST(Daemon, ASessionFileContainsItsCase) {
  Operation operation;
  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  operation.start_daemon();
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.session == bregma_wire_SESSION_REGISTERED; }))
      << operation.logs();
  operation.daemon().signal(SIGTERM);
  ASSERT_EQ(operation.daemon().wait(30.0), 0) << operation.logs();
  const std::filesystem::directory_iterator sessions(operation.case_folder().loaded().folder / "sessions");
  const auto reader = casefile::SessionReader::open(sessions->path());
  ASSERT_TRUE(reader) << reader.error().message;
  for (const char *name : {"case.toml", "fiducials.mrk.json", "surfaces/scalp.ply"}) {
    const auto attached = reader->attachment(name);
    ASSERT_TRUE(attached) << attached.error().message;
    EXPECT_FALSE(attached->empty()) << name;
  }
}

// A reader that joins now, after the daemon has published everything.
template <class T> std::vector<T> received_late(std::uint32_t domain, std::size_t wanted) {
  const dds::Participant participant(domain);
  dds::Reader<T> reader(participant);
  std::vector<T> out;
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20); // only limits a hang
  while (out.size() < wanted && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    reader.take_each([&](const T &sample, const auto &) { out.push_back(sample); });
  }
  return out;
}

TEST(Daemon, ALateClientReceivesEveryCapturedPointAndNothingOfAClosedCase) {
  Operation operation;
  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  operation.start_daemon();
  ASSERT_TRUE(operation.observe_until([&] { return operation.registration.accepted_revision != 0; }))
      << operation.logs();
  const std::size_t samples = operation.registration.fiducial_count + operation.registration.surface_count;
  EXPECT_GT(samples, 100U);
  EXPECT_EQ(received_late<wire::CapturedPoint>(operation.domain(), samples).size(), samples);

  const dds::Participant participant(operation.domain());
  const dds::Writer<wire::Command> commands(participant);
  wire::Command close{};
  ASSERT_TRUE(wire::set_name(close.client, "test"));
  close.id = 1;
  ASSERT_EQ(wire::fill_command(close, bregma_wire_COMMAND_CLOSE_CASE, {}), "");
  ASSERT_TRUE(operation.observe_until([&] { return commands.matched_readers() > 0; }));
  ASSERT_TRUE(commands.write(close));
  ASSERT_TRUE(operation.observe_until([&] {
    return operation.health.session == bregma_wire_SESSION_IDLE && operation.registration.reference[0] == '\0' &&
           !operation.probe.empty() && operation.probe.back().ended;
  })) << operation.logs();
  for (const auto &state : received_late<wire::RegistrationState>(operation.domain(), 3)) {
    EXPECT_EQ(wire::view(state.reference), "") << "the state that no case is loaded";
    EXPECT_EQ(state.accepted_revision, 0U);
  }
}

TEST(Daemon, EndsCleanlyOnSigterm) {
  Operation operation;
  operation.start_daemon();
  ASSERT_TRUE(operation.observe_until([&] { return operation.health.time_ns != 0; })) << operation.logs();
  operation.daemon().signal(SIGTERM);
  EXPECT_EQ(operation.daemon().wait(10.0), 0) << operation.logs();
}

TEST(Daemon, FaultySamplesAndAFloodAreCountedAndDoNotAffectOtherDevices) {
  Operation operation;
  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  operation.start_daemon();
  std::string scenario = "[[steps]]\ndo = \"wait\"\nduration_s = 14.0\n";
  for (const char *sample : {"not_finite", "not_a_rotation", "time_backwards", "time_in_future", "unknown_device",
                             "unknown_tool", "duplicate", "malformed"}) {
    scenario +=
        "[[faults]]\nkind = \"bad_samples\"\nafter_s = 3.0\nsample = \"" + std::string(sample) + "\"\ncount = 5\n";
  }
  scenario += "[[faults]]\nkind = \"flood\"\nafter_s = 6.0\nduration_s = 3.0\nfactor = 10.0\ndevice = \"Force\"\n";
  operation.start_room(scenario);
  ASSERT_TRUE(operation.observe_until([&] { return !operation.room().runs(); }, 60.0)) << operation.logs();
  ASSERT_EQ(operation.room().wait(0.0), 0) << operation.logs();
  operation.observe_for(1.0);

  const wire::DeviceHealth *tracker = operation.device("Tracker");
  const wire::DeviceHealth *force = operation.device("Force");
  const wire::DeviceHealth *robot = operation.device("Robot");
  ASSERT_TRUE(tracker != nullptr && force != nullptr && robot != nullptr) << operation.logs();
  for (const auto reason :
       {bregma_wire_REJECT_NOT_FINITE, bregma_wire_REJECT_NOT_A_ROTATION, bregma_wire_REJECT_TIME_BACKWARDS,
        bregma_wire_REJECT_TIME_IN_FUTURE, bregma_wire_REJECT_DUPLICATE, bregma_wire_REJECT_MALFORMED}) {
    EXPECT_GE(tracker->rejected[reason], 5U) << "reason " << reason << "\n" << operation.logs();
  }
  EXPECT_GE(operation.health.unknown_device_samples, 5U);
  EXPECT_TRUE(operation.alarm_raised(server::alarm::kRejected));
  EXPECT_TRUE(operation.alarm_raised(server::alarm::kUnknownDevice));
  EXPECT_TRUE(operation.alarm_raised(server::alarm::kUnknownTool));
  // The input check rejects the flood and accepts the others as before.
  std::uint64_t refused = 0;
  for (const std::uint64_t number : force->rejected) {
    refused += number;
  }
  EXPECT_GT(refused, 1'000U);
  EXPECT_EQ(robot->rejected[bregma_wire_REJECT_DUPLICATE], 0U);
  EXPECT_GT(robot->taken, 1'000U);
  EXPECT_GT(tracker->taken, 2'500U);
  EXPECT_EQ(tracker->connections, 1U);
  expect_no_pose_that_is_not_live(operation.probe);
}

} // namespace
} // namespace bregma::test
