// The session with a disk that is slow, hangs or fails: only what must be on disk waits for it.
#include "session_fakes.hpp"

#include <deque>
#include <fstream>

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "idl/names.hpp"

namespace bregma::server::testing {
namespace {

// Jobs of the session, which run when the test says so.
class Jobs {
public:
  [[nodiscard]] Executor executor() {
    return [this](Work work, std::function<void()> job) {
      if (held == work) {
        waiting.push_back(std::move(job));
      } else {
        job();
      }
    };
  }
  void run_all() {
    while (!waiting.empty()) {
      const auto job = std::move(waiting.front());
      waiting.pop_front();
      job();
    }
  }

  std::optional<Work> held;
  std::deque<std::function<void()>> waiting;
};

class SlowDisk : public ::testing::Test {
protected:
  TemporaryFolder folder;
  std::filesystem::path ball = write_case(folder.path());
  FakeLoops loops;
  Jobs jobs;
  SessionHarness harness{folder.path(), loops, jobs.executor()};
};

TEST_F(SlowDisk, OnlyTheReplyOfACommandThatChangesTheSessionWaitsForTheDisk) {
  harness.up_to(kVerified, ball);
  harness.condition(alarm::kToolHidden, "Stylus", true, SessionEffect::kNone);
  jobs.held = Work::kSave;
  const auto check = harness.command(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L4");
  EXPECT_FALSE(harness.send(check)) << "its touch is not on disk yet";
  // Refusals, commands without a change, alarms and demotions are not delayed.
  EXPECT_EQ(harness.ask(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L9").result, bregma_wire_COMMAND_REFUSED);
  harness.done(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, alarm::kToolHidden, "Stylus");
  harness.condition(alarm::kDrift, "Reference", true, SessionEffect::kDemote);
  EXPECT_EQ(harness.session->state(), kRegistered);
  EXPECT_FALSE(FakeLoops::last<SessionChanged>(loops.navigation).verified);

  jobs.run_all();
  const auto reply = harness.send(check);
  ASSERT_TRUE(reply);
  EXPECT_EQ(reply->result, bregma_wire_COMMAND_DONE) << reply->text;
  EXPECT_EQ(FakeLoops::count<CaptureRequest>(loops.navigation), 8U) << "it was carried out once";
}

TEST_F(SlowDisk, TheReplyComesAfterTheSnapshotThatContainsTheChange) {
  harness.up_to(kRegistering, ball);
  jobs.held = Work::kSave;
  const auto first = harness.command(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  const auto second = harness.command(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F2");
  EXPECT_FALSE(harness.send(first));
  EXPECT_FALSE(harness.send(second));
  ASSERT_EQ(jobs.waiting.size(), 1U) << "the second snapshot waits for the first, and is written by the same job";
  jobs.run_all();
  const std::size_t before = loops.replies.size();
  harness.run(50.0);
  ASSERT_EQ(loops.replies.size(), before + 2);
  FakeLoops others;
  const SessionHarness restarted(folder.path(), others);
  restarted.session->restore(harness.now_ns);
  EXPECT_EQ(restarted.session->data().fiducials.size(), 2U);
}

TEST_F(SlowDisk, ADiskThatDoesNotAnswerRaisesAnAlarmThatEndsWithItsAnswer) {
  harness.up_to(kRegistering, ball);
  jobs.held = Work::kSave;
  EXPECT_FALSE(harness.send(harness.command(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1")));
  harness.run(2'500.0);
  ASSERT_FALSE(loops.alarms.empty());
  EXPECT_EQ(wire::view(loops.alarms.back().kind), alarm::kDisk);
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_RAISED);
  EXPECT_EQ(loops.alarms.back().severity, bregma_wire_SEVERITY_CRITICAL);
  jobs.run_all();
  harness.run(50.0);
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_CLEARED);
}

TEST_F(SlowDisk, ACaseFolderThatHangsIsGivenUpAndNothingElseWaits) {
  jobs.held = Work::kLoad;
  const auto load = harness.command(bregma_wire_COMMAND_LOAD_CASE, ball.string());
  EXPECT_FALSE(harness.send(load));
  EXPECT_EQ(std::string(harness.ask(bregma_wire_COMMAND_LOAD_CASE, ball.string()).text),
            ball.string() + " is being loaded: wait for the answer");
  EXPECT_EQ(harness.ask(bregma_wire_COMMAND_START_REGISTRATION).result, bregma_wire_COMMAND_REFUSED_BY_STATE);
  harness.run(harness.config.load_timeout_ms);
  const auto late = harness.send(load);
  ASSERT_TRUE(late);
  EXPECT_EQ(std::string(late->text), ball.string() + ": was not loaded within 30 s: is its disk reachable?");
  EXPECT_EQ(harness.session->state(), kIdle);

  jobs.run_all(); // the disk answers at last: the case that was given up stays so
  harness.run(100.0);
  EXPECT_EQ(harness.session->state(), kIdle);
  jobs.held.reset();
  harness.up_to(kCaseLoaded, ball);
}

TEST_F(SlowDisk, ARestartIsIdleUntilItsCaseIsLoadedAndKeepsItsSnapshot) {
  harness.up_to(kRegistered, ball);
  FakeLoops others;
  Jobs later;
  later.held = Work::kLoad;
  SessionHarness restarted(folder.path(), others, later.executor());
  restarted.session->restore(restarted.now_ns);
  EXPECT_EQ(restarted.session->state(), kIdle);
  restarted.condition(alarm::kTrackerLost, "Tracker", true, SessionEffect::kDegrade);
  restarted.run(3'000.0);
  EXPECT_EQ(restarted.ask(bregma_wire_COMMAND_LOAD_CASE, ball.string()).result, bregma_wire_COMMAND_REFUSED);
  restarted.condition(alarm::kTrackerLost, "Tracker", false, SessionEffect::kDegrade);
  later.run_all();
  restarted.run(50.0);
  EXPECT_EQ(restarted.session->state(), kRegistered);
  EXPECT_EQ(restarted.session->data().accepted->revision, harness.session->data().accepted->revision);
}

// A case whose preparation fails as a failing allocation does.
class NoMemory : public FakeLoops {
public:
  PrepareCase preparation() override {
    return [](const auto &) -> base::Result<std::shared_ptr<PreparedCase>> { throw std::bad_alloc(); };
  }
};

TEST_F(SlowDisk, ACaseThatDoesNotFitIntoMemoryIsRefused) {
  NoMemory full;
  SessionHarness other(folder.path() / "other", full, jobs.executor());
  const auto reply = other.ask(bregma_wire_COMMAND_LOAD_CASE, ball.string());
  EXPECT_EQ(reply.result, bregma_wire_COMMAND_REFUSED);
  EXPECT_EQ(std::string(reply.text), ball.string() + ": there is not enough memory to load this case");
  EXPECT_EQ(other.session->state(), kIdle);
}

TEST_F(SlowDisk, APipeOrAFileThatNeverEndsIsNoPartOfACase) {
  const auto scalp = ball / "surfaces" / "scalp.ply";
  ASSERT_TRUE(std::filesystem::remove(scalp));
  ASSERT_EQ(mkfifo(scalp.c_str(), 0600), 0);
  EXPECT_NE(std::string(harness.ask(bregma_wire_COMMAND_LOAD_CASE, ball.string()).text)
                .find("scalp.ply: is not a regular file"),
            std::string::npos);
  ASSERT_TRUE(std::filesystem::remove(scalp));
  std::filesystem::create_symlink("/dev/zero", scalp);
  EXPECT_NE(std::string(harness.ask(bregma_wire_COMMAND_LOAD_CASE, ball.string()).text)
                .find("scalp.ply: is not a regular file"),
            std::string::npos);
  ASSERT_TRUE(std::filesystem::remove(scalp));
  std::ofstream(scalp) << "ply\n";
  std::filesystem::resize_file(scalp, std::uintmax_t{1} << 40); // sparse: it takes no disk
  EXPECT_NE(std::string(harness.ask(bregma_wire_COMMAND_LOAD_CASE, ball.string()).text)
                .find("scalp.ply: is larger than 256 MiB"),
            std::string::npos);
  ASSERT_TRUE(std::filesystem::remove(ball / "case.toml"));
  ASSERT_EQ(mkfifo((ball / "case.toml").c_str(), 0600), 0);
  EXPECT_NE(std::string(harness.ask(bregma_wire_COMMAND_LOAD_CASE, ball.string()).text)
                .find("case.toml: is not a regular file"),
            std::string::npos);
}

TEST_F(SlowDisk, AnotherCommandWithTheNumberAndTimeOfAnEarlierOneIsCarriedOut) {
  harness.up_to(kRegistering, ball);
  const auto touch = harness.command(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  ASSERT_TRUE(harness.send(touch));
  auto remove = harness.command(bregma_wire_COMMAND_REMOVE_FIDUCIAL, "F1");
  remove.id = touch.id;
  remove.sent_time_ns = touch.sent_time_ns;
  const auto reply = harness.send(remove);
  ASSERT_TRUE(reply);
  EXPECT_EQ(reply->kind, bregma_wire_COMMAND_REMOVE_FIDUCIAL);
  EXPECT_TRUE(harness.session->data().fiducials.empty());
}

} // namespace
} // namespace bregma::server::testing
