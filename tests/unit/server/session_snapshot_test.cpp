// The snapshot is restored bit for bit after a crash, and invalid files are rejected.
#include "session_fakes.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <optional>
#include <random>

#include <gtest/gtest.h>

#include "idl/names.hpp"

namespace bregma::server::testing {
namespace {

namespace fs = std::filesystem;

template <class T> bool same_bits(const T &a, const T &b) {
  using Bytes = std::array<std::byte, sizeof(T)>;
  return std::bit_cast<Bytes>(a) == std::bit_cast<Bytes>(b); // -0.0 differs from 0.0, and NaN equals itself
}

std::string read(const fs::path &path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

// Every number from random bits (all magnitudes, including subnormals), fixed seed.
SessionData random_session(unsigned seed) {
  std::mt19937_64 random(seed);
  const auto number = [&random] {
    double value = 0.0;
    do {
      const std::uint64_t bits = random();
      std::memcpy(&value, &bits, sizeof value);
    } while (!std::isfinite(value));
    return value;
  };
  const auto fill = [&number](auto &values) {
    for (double &value : values) {
      value = number();
    }
  };
  SessionData data;
  data.stage = bregma_wire_SESSION_VERIFIED;
  data.case_folder = "/cases/Ä \"quoted\"";
  data.case_id = "ball";
  data.case_checksum = "0123abcd";
  data.recording = "/cases/ball/sessions/1.bregma";
  data.revision = std::numeric_limits<std::uint64_t>::max();
  CalibratedTip tip;
  fill(tip.tip_mm);
  fill(tip.covariance_mm2);
  tip.tip_mm[0] = -0.0;
  tip.tip_mm[1] = std::numeric_limits<double>::denorm_min();
  tip.rms_mm = number();
  tip.time_ns = std::numeric_limits<std::int64_t>::min();
  data.tips["Stylus"] = tip;
  FiducialSample fiducial{};
  EXPECT_TRUE(wire::set_name(fiducial.tool, "Stylus") && wire::set_name(fiducial.point, "F1"));
  fiducial.frame = random();
  fiducial.acquired_time_ns = std::numeric_limits<std::int64_t>::max();
  fill(fiducial.position_mm);
  fill(fiducial.covariance_mm2);
  data.fiducials["F1"] = fiducial;
  for (int i = 0; i < 300; ++i) {
    SurfaceSample sample{};
    EXPECT_TRUE(wire::set_name(sample.tool, "Stylus"));
    fill(sample.position_mm);
    fill(sample.covariance_mm2);
    if (i % 2 == 0) { // by a range sensor
      fill(sample.common_mm2);
      fill(sample.towards_sensor);
      fill(sample.across);
    }
    data.surface.push_back(sample);
  }
  data.accepted.emplace();
  data.accepted->revision = random();
  fill(data.accepted->T_image_reference.rotation_wxyz);
  fill(data.accepted->T_image_reference.translation_mm);
  fill(data.accepted->covariance);
  fill(data.accepted->excess_mm);
  JudgedCheck check{};
  EXPECT_TRUE(wire::set_name(check.tool, "Stylus") && wire::set_name(check.landmark, "L1"));
  fill(check.position_mm);
  fill(check.covariance_mm2);
  fill(check.error_mm);
  fill(check.touch_covariance_mm2);
  check.landmark_index = 3;
  check.distance_mm = number();
  check.limit_mm = number();
  data.checks["L1"] = check;
  return data;
}

TEST(Snapshot, EveryNumberIsRestoredBitForBit) {
  const TemporaryFolder folder;
  const SnapshotFile file(folder.path());
  for (unsigned seed = 1; seed <= 5; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const SessionData before = random_session(seed);
    ASSERT_TRUE(file.save(before));
    const auto loaded = file.load();
    ASSERT_TRUE(loaded) << loaded.error().message;
    const SessionData &after = loaded->value();
    EXPECT_EQ(after.stage, before.stage);
    EXPECT_EQ(after.case_folder, before.case_folder);
    EXPECT_EQ(after.case_id, before.case_id);
    EXPECT_EQ(after.case_checksum, before.case_checksum);
    EXPECT_EQ(after.recording, before.recording);
    EXPECT_EQ(after.revision, before.revision);
    EXPECT_TRUE(same_bits(after.tips.at("Stylus"), before.tips.at("Stylus")));
    EXPECT_TRUE(same_bits(after.fiducials.at("F1").position_mm, before.fiducials.at("F1").position_mm));
    EXPECT_TRUE(same_bits(after.fiducials.at("F1").covariance_mm2, before.fiducials.at("F1").covariance_mm2));
    EXPECT_EQ(after.fiducials.at("F1").frame, before.fiducials.at("F1").frame);
    EXPECT_EQ(after.fiducials.at("F1").acquired_time_ns, before.fiducials.at("F1").acquired_time_ns);
    ASSERT_EQ(after.surface.size(), before.surface.size());
    for (std::size_t i = 0; i < after.surface.size(); ++i) {
      EXPECT_TRUE(same_bits(after.surface[i].position_mm, before.surface[i].position_mm));
      EXPECT_TRUE(same_bits(after.surface[i].covariance_mm2, before.surface[i].covariance_mm2));
    }
    EXPECT_TRUE(same_bits(*after.accepted, *before.accepted));
    const JudgedCheck &check = after.checks.at("L1");
    EXPECT_EQ(wire::view(check.landmark), "L1");
    EXPECT_TRUE(same_bits(check.error_mm, before.checks.at("L1").error_mm));
    EXPECT_TRUE(same_bits(check.touch_covariance_mm2, before.checks.at("L1").touch_covariance_mm2));
    EXPECT_EQ(check.landmark_index, 3U);
  }
  EXPECT_FALSE(fs::exists(file.path().string() + ".tmp"));
}

TEST(Snapshot, EveryDamageIsDetected) {
  const TemporaryFolder folder;
  const SnapshotFile file(folder.path());
  ASSERT_TRUE(file.save(random_session(1)));
  const std::string whole = read(file.path());
  std::mt19937 random(11);
  for (int i = 0; i < 200; ++i) {
    std::string damaged = whole;
    const std::size_t at = random() % (whole.size() - 1); // except the newline at the end
    damaged[at] = static_cast<char>(damaged[at] ^ (1 << (random() % 7)));
    const auto read_back = from_json(damaged, "session.json");
    EXPECT_FALSE(read_back) << "seed 11, byte " << at << " damaged and not noticed";
  }
  EXPECT_FALSE(from_json(whole.substr(0, whole.size() / 2), "session.json"));
  EXPECT_FALSE(from_json("", "session.json"));
}

TEST(Snapshot, ADamagedFileIsRenamedAndTheReasonReported) {
  const TemporaryFolder folder;
  const SnapshotFile file(folder.path());
  std::string kept = file.path().string() + ".bad";
  int number = 1;
  const auto load_text = [&](const std::string &text) {
    std::ofstream(file.path()) << text;
    const auto loaded = file.load();
    EXPECT_FALSE(loaded);
    EXPECT_FALSE(fs::exists(file.path()));
    EXPECT_EQ(read(kept), text) << "an earlier one is not replaced";
    kept = file.path().string() + ".bad." + std::to_string(++number);
    return loaded ? std::string() : loaded.error().message;
  };
  const std::string name = file.path().string();
  EXPECT_EQ(load_text(R"({"bregma_session":9,"crc32":"00000000","session":{}})"),
            name + ": bregma_session = 9: this program reads version 3");
  EXPECT_EQ(load_text(R"({"bregma_session":3,"crc32":"00000000","session":{}})"),
            name + ": crc32 = \"00000000\": the content has \"a3a6bf43\", the file is damaged");
  EXPECT_EQ(load_text(R"({"bregma_session":1,"crc32":"00000000","session":{}})"),
            name + ": bregma_session = 1: this program reads version 3");
  EXPECT_NE(load_text("{").find(name + ": not a session that can be read: "), std::string::npos);
  const auto none = file.load();
  ASSERT_TRUE(none);
  EXPECT_FALSE(none->has_value());
}

TEST(Snapshot, AFailedSaveNamesTheFileAndKeepsTheLastOne) {
  const TemporaryFolder folder;
  const SnapshotFile file(folder.path());
  ASSERT_TRUE(file.save(random_session(1)));
  const std::string before = read(file.path());
  fs::create_directory(file.path().string() + ".tmp"); // cannot be written, not even by root
  const auto failed = file.save(random_session(2));
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().message, file.path().string() + ".tmp: cannot be written: Is a directory");
  EXPECT_EQ(read(file.path()), before);
}

class RestartTest : public ::testing::Test {
protected:
  TemporaryFolder folder;
  fs::path ball = write_case(folder.path());
  FakeLoops loops;
  FakeLoops loops_after;
  std::string log() const {
    std::string out;
    for (const std::string &line : loops_after.lines) {
      out += line + "\n";
    }
    return out;
  }
};

TEST_F(RestartTest, NavigatingIsRestoredAsRegisteredAndAsksForVerification) {
  SessionHarness harness(folder.path(), loops);
  harness.up_to(bregma_wire_SESSION_NAVIGATING, ball);
  const SessionData before = harness.session->data(); // then the process is killed without destructors
  SessionHarness restarted(folder.path(), loops_after);
  restarted.session->restore(restarted.now_ns);
  EXPECT_EQ(restarted.session->state(), bregma_wire_SESSION_REGISTERED) << log();
  const auto accepted = FakeLoops::last<RegistrationAccepted>(loops_after.navigation);
  EXPECT_TRUE(same_bits(accepted, *before.accepted));
  EXPECT_EQ(FakeLoops::count<FiducialSample>(loops_after.registration), 4U);
  EXPECT_EQ(FakeLoops::count<SurfaceSample>(loops_after.registration), 20U);
  EXPECT_EQ(loops_after.revision, accepted.revision) << "the estimate of these samples is the accepted one";
  EXPECT_TRUE(same_bits(FakeLoops::last<ToolTip>(loops_after.navigation).tip_mm, before.tips.at("Stylus").tip_mm));
  EXPECT_FALSE(FakeLoops::last<SessionChanged>(loops_after.navigation).verified);
  EXPECT_EQ(loops_after.captured.size(), 24U);
  EXPECT_EQ(wire::view(loops_after.alarms.back().kind), "verification");
  EXPECT_STREQ(restarted.ask(bregma_wire_COMMAND_START_NAVIGATION, "Stylus", "Plan").text,
               "cannot start the navigation while Registered: verify the registration first");
  EXPECT_EQ(restarted.ask(bregma_wire_COMMAND_CONFIRM_VERIFICATION).result, bregma_wire_COMMAND_REFUSED)
      << "the checks of before do not count";
  restarted.up_to(bregma_wire_SESSION_NAVIGATING, ball);
}

TEST_F(RestartTest, EveryReplyIsOnDiskBeforeItIsSent) {
  SessionHarness harness(folder.path(), loops);
  harness.up_to(bregma_wire_SESSION_REGISTERING, ball);
  for (const char *fiducial : {"F1", "F2"}) {
    harness.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", fiducial);
    FakeLoops other;
    SessionHarness restarted(folder.path(), other);
    restarted.session->restore(restarted.now_ns);
    EXPECT_EQ(restarted.session->state(), bregma_wire_SESSION_REGISTERING);
    EXPECT_TRUE(restarted.session->data().fiducials.contains(fiducial));
    EXPECT_EQ(restarted.session->data().tips.size(), 1U);
  }
}

TEST_F(RestartTest, ATraceIsSavedWhileItRuns) {
  SessionHarness harness(folder.path(), loops);
  harness.up_to(bregma_wire_SESSION_REGISTERING, ball);
  harness.done(bregma_wire_COMMAND_START_TRACE, "Stylus");
  harness.trace("Stylus", 12);
  harness.run(1500.0);
  SessionHarness restarted(folder.path(), loops_after);
  restarted.session->restore(restarted.now_ns);
  EXPECT_EQ(restarted.session->data().surface.size(), 12U);
}

TEST_F(RestartTest, AClosedCaseStaysClosed) {
  SessionHarness harness(folder.path(), loops);
  harness.up_to(bregma_wire_SESSION_CASE_LOADED, ball);
  harness.session->recording_to("/recordings/7.bregma");
  harness.done(bregma_wire_COMMAND_CLOSE_CASE);
  SessionHarness restarted(folder.path(), loops_after);
  restarted.session->restore(restarted.now_ns);
  EXPECT_EQ(restarted.session->state(), bregma_wire_SESSION_IDLE);
  EXPECT_EQ(log(), "no session to restore\n");
  EXPECT_EQ(harness.session->data().recording, "/recordings/7.bregma");
}

TEST_F(RestartTest, ADamagedSnapshotStartsIdleWithTheReason) {
  SessionHarness harness(folder.path(), loops);
  harness.up_to(bregma_wire_SESSION_REGISTERED, ball);
  const fs::path snapshot = folder.path() / "state/session.json";
  std::string text = read(snapshot);
  text[text.find("rotation_wxyz") + 20] ^= 1;
  std::ofstream(snapshot) << text;
  SessionHarness restarted(folder.path(), loops_after);
  restarted.session->restore(restarted.now_ns);
  EXPECT_EQ(restarted.session->state(), bregma_wire_SESSION_IDLE);
  EXPECT_NE(log().find("the last session is not restored: " + snapshot.string() + ": "), std::string::npos) << log();
  EXPECT_EQ(read(snapshot.string() + ".bad"), text);
  ASSERT_FALSE(loops_after.alarms.empty());
  EXPECT_EQ(wire::view(loops_after.alarms.back().kind), "restore");
  EXPECT_EQ(loops_after.alarms.back().state, bregma_wire_ALARM_RAISED);
  restarted.up_to(bregma_wire_SESSION_CASE_LOADED, ball);
  EXPECT_EQ(loops_after.alarms.back().state, bregma_wire_ALARM_CLEARED);
}

TEST_F(RestartTest, ASnapshotThatCannotBeReadIsKept) {
  fs::create_directory(folder.path() / "state");
  const fs::path snapshot = folder.path() / "state/session.json";
  fs::create_symlink(snapshot, snapshot); // cannot be opened, not even by root
  SessionHarness restarted(folder.path(), loops_after);
  restarted.session->restore(restarted.now_ns);
  EXPECT_EQ(restarted.session->state(), bregma_wire_SESSION_IDLE);
  EXPECT_TRUE(fs::is_symlink(snapshot.string() + ".bad"));
  ASSERT_FALSE(loops_after.alarms.empty());
  EXPECT_EQ(wire::view(loops_after.alarms.back().kind), "restore");
}

TEST_F(RestartTest, AnotherCaseInTheFolderStartsIdle) {
  {
    SessionHarness harness(folder.path(), loops);
    harness.up_to(bregma_wire_SESSION_REGISTERED, ball);
  }
  const fs::path snapshot = folder.path() / "state/session.json";
  const std::string kept = read(snapshot);
  fs::rename(ball, folder.path() / "elsewhere");
  fs::rename(write_case(folder.path(), "another"), ball);
  SessionHarness restarted(folder.path(), loops_after);
  restarted.session->restore(restarted.now_ns);
  EXPECT_EQ(restarted.session->state(), bregma_wire_SESSION_IDLE);
  EXPECT_EQ(read(snapshot.string() + ".bad"), kept);
  EXPECT_EQ(log(), "the last session is not restored: " + ball.string() + " holds case another now, it was ball\n");
}

// A restart while the drive with the case is not mounted.
class AwayCaseTest : public RestartTest {
protected:
  void SetUp() override {
    {
      SessionHarness harness(folder.path(), loops);
      harness.up_to(bregma_wire_SESSION_VERIFIED, ball);
    }
    kept = read(snapshot);
    fs::rename(ball, elsewhere);
    restarted.emplace(folder.path(), loops_after);
    restarted->session->restore(restarted->now_ns);
  }

  const fs::path snapshot = folder.path() / "state/session.json";
  const fs::path elsewhere = folder.path() / "elsewhere";
  std::string kept;
  std::optional<SessionHarness> restarted;
};

TEST_F(AwayCaseTest, RaisesAnAlarmAndKeepsTheSnapshot) {
  restarted->run(60'000.0);
  EXPECT_EQ(restarted->session->state(), bregma_wire_SESSION_IDLE);
  EXPECT_EQ(read(snapshot), kept);
  ASSERT_EQ(loops_after.alarms.size(), 1U);
  EXPECT_EQ(wire::view(loops_after.alarms.back().kind), "restore");
  EXPECT_NE(std::string(loops_after.alarms.back().text).find(ball.string() + ": is not a folder"), std::string::npos);
}

TEST_F(AwayCaseTest, IsRestoredAsRegisteredWhenTheFolderIsBack) {
  restarted->run(10'000.0);
  fs::rename(elsewhere, ball);
  restarted->run(3'000.0);
  EXPECT_EQ(restarted->session->state(), bregma_wire_SESSION_REGISTERED);
  EXPECT_FALSE(FakeLoops::last<SessionChanged>(loops_after.navigation).verified);
  const auto restore_alarm = std::find_if(loops_after.alarms.rbegin(), loops_after.alarms.rend(),
                                          [](const auto &alarm) { return wire::view(alarm.kind) == "restore"; });
  ASSERT_NE(restore_alarm, loops_after.alarms.rend());
  EXPECT_EQ(restore_alarm->state, bregma_wire_ALARM_CLEARED);
}

TEST_F(AwayCaseTest, IsNotRestoredOntoACaseThatHasChanged) {
  const fs::path toml = elsewhere / "case.toml";
  std::string text = read(toml);
  const std::string key = "max_check_mm = ";
  text.insert(text.find(key) + key.size(), "1"); // 3 mm becomes 13 mm
  std::ofstream(toml) << text;
  fs::rename(elsewhere, ball);
  restarted->run(3'000.0);
  EXPECT_EQ(restarted->session->state(), bregma_wire_SESSION_IDLE);
  EXPECT_NE(log().find("case ball has changed since this session"), std::string::npos) << log();
  EXPECT_EQ(read(snapshot.string() + ".bad"), kept);
}

TEST_F(AwayCaseTest, IsGivenUpWhenAnyCaseIsLoaded) {
  const fs::path another = write_case(folder.path(), "another");
  restarted->done(bregma_wire_COMMAND_LOAD_CASE, another.string());
  fs::rename(elsewhere, ball);
  restarted->run(10'000.0);
  EXPECT_EQ(restarted->session->loaded_case()->id, "another");
  EXPECT_EQ(read(snapshot.string() + ".bad"), kept);
  EXPECT_EQ(loops_after.alarms.back().state, bregma_wire_ALARM_CLEARED);
}

TEST_F(AwayCaseTest, IsGivenUpEvenWhenTheLoadedCaseIsRefused) {
  EXPECT_EQ(restarted->ask(bregma_wire_COMMAND_LOAD_CASE, "/nowhere").result, bregma_wire_COMMAND_REFUSED);
  fs::rename(elsewhere, ball);
  restarted->run(10'000.0);
  EXPECT_EQ(restarted->session->state(), bregma_wire_SESSION_IDLE);
}

TEST_F(RestartTest, AFullDiskRaisesAnAlarmAndTheSessionContinues) {
  SessionHarness harness(folder.path(), loops);
  harness.up_to(bregma_wire_SESSION_REGISTERING, ball);
  fs::create_directory(folder.path() / "state/session.json.tmp");
  harness.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  EXPECT_EQ(wire::view(loops.alarms.back().kind), alarm::kDisk);
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_RAISED);
  fs::remove(folder.path() / "state/session.json.tmp");
  harness.run(1500.0); // retried automatically
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_CLEARED);
}

} // namespace
} // namespace bregma::server::testing
