// The connection to a daemon over DDS, with a small daemon in this process.
#include <thread>

#include <gtest/gtest.h>

#include "clients/cli/command_reply.hpp"
#include "clients/cli/daemon_link.hpp"
#include "clients/cli/live_view.hpp"
#include "tests/unit/cli/fake_daemon.hpp"

namespace {

using namespace bregma;
using namespace bregma::cli;
using namespace std::chrono_literals;
using test::FakeDaemon;
using test::own_domain;
using test::reply_to;

TEST(DaemonLink, WithoutADaemonItSaysSo) {
  DaemonLink link(own_domain());
  const auto there = link.wait_for_daemon(300ms);
  ASSERT_FALSE(there.has_value());
  EXPECT_EQ(there.error().message, "no bregmad answers on domain " + std::to_string(own_domain()) + ": is it running?");
  EXPECT_FALSE(link.alive(utc_now_ns()));
}

TEST(DaemonLink, StateIsReceivedCompletelyAndCurrent) {
  const FakeDaemon daemon;
  DaemonLink link(own_domain());
  ASSERT_TRUE(link.wait_for_daemon(5s).has_value());
  link.settle();
  EXPECT_TRUE(link.alive(utc_now_ns()));
  EXPECT_EQ(link.snapshot().tools.size(), 2U);
  EXPECT_EQ(link.snapshot().alarms.size(), 1U);
  EXPECT_EQ(view_daemon(link.snapshot(), utc_now_ns()).text, "verified");
}

TEST(DaemonLink, CommandArrivesAndItsOwnReplyComesBack) {
  const FakeDaemon daemon([](const wire::Command &command) {
    EXPECT_EQ(command.kind, bregma_wire_COMMAND_START_NAVIGATION);
    EXPECT_EQ(wire::view(command.body._u.plan.tool), "Probe");
    EXPECT_EQ(wire::view(command.body._u.plan.trajectory), "Biopsy");
    return reply_to(command, bregma_wire_COMMAND_DONE, "navigating Probe along Biopsy");
  });
  DaemonLink link(own_domain());
  const auto command = make_command(bregma_wire_COMMAND_START_NAVIGATION, {"Probe", "Biopsy"});
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
  DaemonLink link(own_domain());
  const auto reply = link.send(*make_command(bregma_wire_COMMAND_STOP_NAVIGATION));
  ASSERT_TRUE(reply.has_value());
  testing::internal::CaptureStderr();
  EXPECT_EQ(show_reply(reply, Context{}), kRefused);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "bregma: refused by state: the registration is not verified\n");
}

TEST(DaemonLink, ReplyToAnotherClientIsNotOurs) {
  const FakeDaemon daemon([](const wire::Command &command) {
    auto reply = reply_to(command, bregma_wire_COMMAND_DONE, "");
    (void)wire::set_name(reply.client, "somebody else");
    return reply;
  });
  DaemonLink link(own_domain());
  const auto reply = link.send(*make_command(bregma_wire_COMMAND_STOP_NAVIGATION), 300ms);
  ASSERT_FALSE(reply.has_value());
  EXPECT_EQ(reply.error().message,
            "bregmad on domain " + std::to_string(own_domain()) +
                " did not reply within 300 ms; it is not known whether it carried out the command");
}

TEST(DaemonLink, DaemonThatFallsSilentIsNotAlive) {
  FakeDaemon daemon;
  DaemonLink link(own_domain());
  ASSERT_TRUE(link.wait_for_daemon(5s).has_value());
  daemon.speaking = false;
  std::this_thread::sleep_for(100ms);
  (void)link.update(0ns);
  const std::int64_t later_ns = utc_now_ns() + kDaemonSilent.count();
  EXPECT_FALSE(link.alive(later_ns));
  EXPECT_EQ(view_daemon(link.snapshot(), later_ns).presence, Presence::kSilent);
}

TEST(DaemonLink, ADaemonOfAnotherWireIsNamedWithBothVersions) {
  // A daemon whose types are another generation's does not match, and is seen by what its participant announces.
  const dds::Participant other(own_domain(), {{3, 1}, "bregmad"});
  const dds::Writer<wire::SystemHealth> health(other);
  DaemonLink link(own_domain());
  const auto there = link.wait_for_daemon(1s);
  ASSERT_FALSE(there.has_value());
  EXPECT_EQ(there.error().message, "no bregmad answers on domain " + std::to_string(own_domain()) +
                                       ": bregmad speaks wire 3.1, this program speaks wire 2.1: install one release "
                                       "on both");
  EXPECT_NE(watch_line(link.snapshot(), {}, utc_now_ns()).find("wire: bregmad speaks wire 3.1, this program"),
            std::string::npos);
}

TEST(DaemonLink, EveryClientHasANameOfItsOwn) {
  const DaemonLink one(own_domain());
  const DaemonLink two(own_domain());
  EXPECT_NE(one.client(), two.client());
  EXPECT_LE(one.client().size(), wire::kNameLength);
}

TEST(MakeCommand, NamesThatDoNotFitAreShownAndRefused) {
  const auto long_name = make_command(bregma_wire_COMMAND_CHECK_TOUCH, {"Stylus", std::string(40, 'x')});
  ASSERT_FALSE(long_name.has_value());
  EXPECT_EQ(long_name.error().message, "point '" + std::string(40, 'x') + "' is too long: 40 bytes, at most 31");
  EXPECT_EQ(make_command(bregma_wire_COMMAND_START_PIVOT).error().message, "tool is empty");
  EXPECT_FALSE(make_command(bregma_wire_COMMAND_LOAD_CASE, {std::string(2000, 'y')}).has_value());
  EXPECT_TRUE(make_command(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, {"drift"}).has_value())
      << "an alarm may have no subject";
}

} // namespace
