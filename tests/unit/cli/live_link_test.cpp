// The connection to a daemon over DDS, with a small daemon in this process.
#include <filesystem>
#include <iterator>
#include <memory>
#include <thread>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "clients/cli/command_reply.hpp"
#include "clients/cli/live_view.hpp"
#include "clients/live/daemon_link.hpp"
#include "idl/version.hpp"
#include "tests/unit/live/fake_daemon.hpp"

namespace {

using namespace bregma;
using namespace bregma::cli;
using namespace std::chrono_literals;
using test::FakeDaemon;
using test::own_domain;
using test::reply_to;

const std::string kOwnWire = wire::text_of(wire::kWireVersion);

TEST(DaemonLink, WithoutADaemonItSaysSo) {
  live::DaemonLink link(own_domain(), live::DaemonLink::Role::kReads);
  const auto there = link.wait_for_daemon(300ms);
  ASSERT_FALSE(there.has_value());
  EXPECT_EQ(there.error().message, "no bregmad answers on domain " + std::to_string(own_domain()) + ": is it running?");
  EXPECT_FALSE(live::alive(link.snapshot(), live::Now::read().boot_ns));
}

TEST(DaemonLink, StateIsReceivedCompletelyAndCurrent) {
  const FakeDaemon daemon;
  live::DaemonLink link(own_domain(), live::DaemonLink::Role::kReads);
  ASSERT_TRUE(link.wait_for_daemon(5s).has_value());
  link.settle();
  EXPECT_TRUE(live::alive(link.snapshot(), live::Now::read().boot_ns));
  EXPECT_EQ(link.snapshot().tools.size(), 2U);
  EXPECT_EQ(link.snapshot().alarms.size(), 1U);
  EXPECT_EQ(view_daemon(link.snapshot(), live::Now::read()).text, "verified");
}

TEST(DaemonLink, CommandArrivesAndItsOwnReplyComesBack) {
  const FakeDaemon daemon([](const wire::Command &command) {
    EXPECT_EQ(command.kind, bregma_wire_COMMAND_START_NAVIGATION);
    EXPECT_EQ(wire::view(command.body._u.plan.tool), "Probe");
    EXPECT_EQ(wire::view(command.body._u.plan.trajectory), "Biopsy");
    return reply_to(command, bregma_wire_COMMAND_DONE, "navigating Probe along Biopsy");
  });
  live::DaemonLink link(own_domain(), live::DaemonLink::Role::kCommands);
  const auto command = live::make_command(bregma_wire_COMMAND_START_NAVIGATION, {"Probe", "Biopsy"});
  ASSERT_TRUE(command.has_value());
  for (int i = 0; i < 3; ++i) {
    const auto reply = link.send(*command);
    ASSERT_TRUE(reply.has_value()) << reply.error().message;
    EXPECT_EQ(reply->id, static_cast<std::uint64_t>(i + 1));
    EXPECT_STREQ(reply->text, "navigating Probe along Biopsy");
    EXPECT_EQ(show_reply(reply, Context{}), kOk);
  }
}

TEST(DaemonLink, RefusalIsAReplyWithItsReason) {
  const FakeDaemon daemon([](const wire::Command &command) {
    return reply_to(command, bregma_wire_COMMAND_REFUSED_BY_STATE, "the registration is not verified");
  });
  live::DaemonLink link(own_domain(), live::DaemonLink::Role::kCommands);
  const auto reply = link.send(*live::make_command(bregma_wire_COMMAND_STOP_NAVIGATION));
  ASSERT_TRUE(reply.has_value());
  testing::internal::CaptureStderr();
  EXPECT_EQ(show_reply(reply, Context{}), kRefused);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "bregma: refused by state: the registration is not verified\n");
}

TEST(DaemonLink, ADevicesReplyNamesNoSession) {
  wire::CommandReply reply = reply_to({}, bregma_wire_COMMAND_DONE, "24 slices of tree-coronal");
  reply.session = bregma_wire_SESSION_UNKNOWN;
  testing::internal::CaptureStdout();
  EXPECT_EQ(show_reply(reply, Context{}), kOk);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "24 slices of tree-coronal\n");
  testing::internal::CaptureStdout();
  Context json;
  json.json = true;
  EXPECT_EQ(show_reply(reply, json), kOk);
  EXPECT_TRUE(nlohmann::json::parse(testing::internal::GetCapturedStdout())["session"].is_null());
}

TEST(DaemonLink, ReplyToAnotherClientIsNotOurs) {
  const FakeDaemon daemon([](const wire::Command &command) {
    auto reply = reply_to(command, bregma_wire_COMMAND_DONE, "");
    (void)wire::set_name(reply.client, "somebody else");
    return reply;
  });
  live::DaemonLink link(own_domain(), live::DaemonLink::Role::kCommands);
  const auto reply = link.send(*live::make_command(bregma_wire_COMMAND_STOP_NAVIGATION), 300ms);
  ASSERT_FALSE(reply.has_value());
  EXPECT_EQ(reply.error().message,
            "bregmad on domain " + std::to_string(own_domain()) +
                " did not reply within 300 ms; it is not known whether it carried out the command");
}

TEST(DaemonLink, DaemonThatFallsSilentIsNotAlive) {
  FakeDaemon daemon;
  live::DaemonLink link(own_domain(), live::DaemonLink::Role::kReads);
  ASSERT_TRUE(link.wait_for_daemon(5s).has_value());
  daemon.speaking = false;
  std::this_thread::sleep_for(100ms);
  (void)link.update(0ns);
  live::Now later = live::Now::read();
  later.boot_ns += live::kDaemonSilent_ns;
  EXPECT_FALSE(live::alive(link.snapshot(), later.boot_ns));
  EXPECT_EQ(view_daemon(link.snapshot(), later).presence, Presence::kSilent);
}

TEST(DaemonLink, ADaemonOfAnotherWireIsNamedWithBothVersions) {
  // A daemon whose types are another generation's does not match, and is seen by what its participant announces.
  const dds::Participant other(own_domain(), {{3, 1}, "bregmad"});
  const dds::Writer<wire::SystemHealth> health(other);
  live::DaemonLink link(own_domain(), live::DaemonLink::Role::kReads);
  const auto there = link.wait_for_daemon(1s);
  ASSERT_FALSE(there.has_value());
  EXPECT_EQ(there.error().message, "no bregmad answers on domain " + std::to_string(own_domain()) +
                                       ": bregmad speaks wire 3.1, this program speaks wire " + kOwnWire +
                                       ": install one release "
                                       "on both");
  EXPECT_NE(watch_line(link.snapshot(), {}, live::Now::read()).find("wire: bregmad speaks wire 3.1, this program"),
            std::string::npos);
}

// Updates until the condition holds; the limit only ends a hang.
template <class Condition> bool reaches(live::DaemonLink &link, Condition condition, std::chrono::seconds limit = 20s) {
  const auto end = std::chrono::steady_clock::now() + limit;
  while (std::chrono::steady_clock::now() < end) {
    (void)link.update(20ms);
    if (condition()) {
      return true;
    }
  }
  return false;
}

ToolView probe(live::DaemonLink &link, const live::Now &now) {
  const auto found = link.snapshot().tools.find("Probe");
  return found == link.snapshot().tools.end() ? ToolView{}
                                              : view_tool(found->second, view_daemon(link.snapshot(), now), now);
}

TEST(DaemonLink, ClocksOfDaemonAndClientMayDifferAndThePoseStillEndsInTime) {
  for (const auto clock : {-30s, -10s, 0s, 30s}) {
    FakeDaemon daemon({}, std::chrono::nanoseconds(clock).count());
    live::DaemonLink link(own_domain(), live::DaemonLink::Role::kReads);
    ASSERT_TRUE(reaches(link, [&] { return probe(link, live::Now::read()).fresh; })) << clock.count();
    const auto &state = link.snapshot().tools.at("Probe");
    // Nothing is taken any more, as with a link that is cut: the same state at later times.
    live::Now now{state.arrival.boot_ns, live::Now::read().utc_ns};
    const ToolView arrived = probe(link, now);
    EXPECT_GE(arrived.age_ms, FakeDaemon::kAge_ns * 1e-6);
    EXPECT_LE(arrived.remaining_ms, FakeDaemon::kValidFor_ns * 1e-6);
    EXPECT_NEAR(arrived.age_ms + arrived.remaining_ms, 100.0, 1e-6) << "the limit of the rule";
    EXPECT_NEAR(static_cast<double>(*link.snapshot().clock_difference_ns) * 1e-9, -static_cast<double>(clock.count()),
                0.1);
    const bool differs = connection_text(link.snapshot()).find("Clock: this host's is") != std::string::npos;
    EXPECT_EQ(differs, clock != 0s) << connection_text(link.snapshot());
    now.boot_ns = state.published_boot_ns + FakeDaemon::kValidFor_ns - 1;
    EXPECT_TRUE(probe(link, now).fresh);
    ++now.boot_ns;
    EXPECT_FALSE(probe(link, now).fresh);
    EXPECT_EQ(probe(link, now).status, "too old");
    now.boot_ns += 3'000'000'000;
    EXPECT_FALSE(probe(link, now).fresh);
    EXPECT_EQ(view_daemon(link.snapshot(), now).presence, Presence::kSilent);
  }
}

TEST(DaemonLink, TheFirstDaemonIsFollowedUntilItIsLostAndTheOtherOneIsNamed) {
  auto first = std::make_unique<FakeDaemon>(FakeDaemon::Answer{}, 0, 1.0);
  live::DaemonLink link(own_domain(), live::DaemonLink::Role::kReads);
  ASSERT_TRUE(reaches(link, [&] { return probe(link, live::Now::read()).fresh; }));
  FakeDaemon second({}, 0, 2.0);
  ASSERT_TRUE(reaches(link, [&] { return link.snapshot().other_daemons.find("test_cli_live also") == 0; }));
  EXPECT_NE(watch_table(link.snapshot(), {}, live::Now::read()).find("WARNING: test_cli_live also writes the topics"),
            std::string::npos);
  for (int i = 0; i < 100; ++i) {
    (void)link.update(5ms);
    ASSERT_EQ(link.snapshot().tools.at("Probe").T_image_tip.translation_mm[0], 1.0) << "never alternating";
  }
  first.reset();
  ASSERT_TRUE(reaches(link, [&] { return link.snapshot().changes == 1; }));
  EXPECT_EQ(link.snapshot().tools.at("Probe").T_image_tip.translation_mm[0], 2.0);
  EXPECT_TRUE(reaches(link, [&] { return link.snapshot().other_daemons.empty(); }));
}

TEST(DaemonLink, AToolWhoseCaseIsClosedLeavesTheView) {
  FakeDaemon daemon;
  live::DaemonLink link(own_domain(), live::DaemonLink::Role::kReads);
  ASSERT_TRUE(reaches(link, [&] { return link.snapshot().tools.size() == 2; }));
  daemon.case_open = false;
  EXPECT_TRUE(reaches(link, [&] { return link.snapshot().tools.empty(); }));
  EXPECT_TRUE(live::alive(link.snapshot(), live::Now::read().boot_ns));
}

TEST(DaemonLink, AClientThatOnlyReadsCreatesNoWriter) {
  const FakeDaemon daemon;
  live::DaemonLink reads(own_domain(), live::DaemonLink::Role::kReads);
  ASSERT_TRUE(reads.wait_for_daemon(5s).has_value());
  reads.settle();
  EXPECT_EQ(daemon.commanders(), 0U);
  live::DaemonLink commands(own_domain(), live::DaemonLink::Role::kCommands);
  ASSERT_TRUE(commands.wait_for_daemon(5s).has_value());
  EXPECT_TRUE(reaches(commands, [&] { return daemon.commanders() == 1; }));
}

TEST(DaemonLink, NoThreadOfDdsIsLeftAfterItsEnd) {
  const auto threads = [] {
    const std::filesystem::directory_iterator tasks("/proc/self/task");
    return std::distance(begin(tasks), end(tasks));
  };
  const auto before = threads();
  {
    const live::DaemonLink link(own_domain(), live::DaemonLink::Role::kReads);
    EXPECT_GT(threads(), before);
  }
  EXPECT_EQ(threads(), before) << "main may return: nothing runs while static objects are destroyed";
}

TEST(DaemonLink, EveryClientHasANameOfItsOwn) {
  const live::DaemonLink one(own_domain(), live::DaemonLink::Role::kReads);
  const live::DaemonLink two(own_domain(), live::DaemonLink::Role::kReads);
  EXPECT_NE(one.client(), two.client());
  EXPECT_LE(one.client().size(), wire::kNameLength);
}

TEST(MakeCommand, NamesThatDoNotFitAreShownAndRefused) {
  const auto long_name = live::make_command(bregma_wire_COMMAND_CHECK_TOUCH, {"Stylus", std::string(40, 'x')});
  ASSERT_FALSE(long_name.has_value());
  EXPECT_EQ(long_name.error().message, "point '" + std::string(40, 'x') + "' is too long: 40 bytes, at most 31");
  EXPECT_EQ(live::make_command(bregma_wire_COMMAND_START_PIVOT).error().message, "tool is empty");
  EXPECT_FALSE(live::make_command(bregma_wire_COMMAND_LOAD_CASE, {std::string(2000, 'y')}).has_value());
  EXPECT_TRUE(live::make_command(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, {"drift"}).has_value())
      << "an alarm may have no subject";
}

} // namespace
