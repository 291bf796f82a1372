#include <chrono>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <unistd.h>

#include "idl/commands.hpp"
#include "idl/dds.hpp"
#include "idl/names.hpp"

namespace {

using namespace bregma;
using namespace std::chrono_literals;

std::uint32_t own_domain() { return 100 + static_cast<std::uint32_t>(getpid()) % 100; }

template <class T> void wait_for_match(const dds::Writer<T> &writer) {
  for (int i = 0; i < 500 && writer.matched_readers() == 0; ++i) {
    usleep(10'000);
  }
  ASSERT_GT(writer.matched_readers(), 0U);
}

TEST(Dds, TrackerFrameArrivesCompleteAndOnce) {
  const dds::Participant out(own_domain());
  const dds::Participant in(own_domain());
  dds::Reader<wire::TrackerFrame> reader(in);
  const dds::Writer<wire::TrackerFrame> writer(out);
  dds::WaitSet wait(in);
  wait.attach(reader);
  wait_for_match(writer);

  wire::TrackerFrame frame{};
  ASSERT_TRUE(wire::set_name(frame.device, "Tracker"));
  frame.frame = 42;
  frame.tool_count = 1;
  ASSERT_TRUE(wire::set_name(frame.tools[0].tool, "Stylus"));
  frame.tools[0].T_tracker_tool = {{1, 0, 0, 0}, {1.5, -2.5, 3.5}};
  ASSERT_TRUE(writer.write(frame));

  std::vector<wire::TrackerFrame> taken;
  for (int i = 0; i < 100 && taken.empty(); ++i) {
    wait.wait(50ms);
    reader.take_each([&](const wire::TrackerFrame &sample, const dds::SampleInfo &info) {
      EXPECT_GT(info.source_time_ns, 0);
      taken.push_back(sample);
    });
  }
  ASSERT_EQ(taken.size(), 1U);
  EXPECT_EQ(taken[0].frame, 42U);
  EXPECT_EQ(wire::view(taken[0].tools[0].tool), "Stylus");
  EXPECT_EQ(taken[0].tools[0].T_tracker_tool.translation_mm[1], -2.5);
}

TEST(Dds, LateReaderReceivesTheCurrentState) {
  const dds::Participant out(own_domain());
  const dds::Writer<wire::RegistrationState> writer(out);
  wire::RegistrationState state{};
  ASSERT_TRUE(wire::set_name(state.reference, "Reference"));
  for (std::uint64_t revision = 1; revision <= 3; ++revision) {
    state.revision = revision;
    wire::set_text(state.text, "revision " + std::to_string(revision));
    ASSERT_TRUE(writer.write(state));
  }
  const dds::Participant in(own_domain());
  dds::Reader<wire::RegistrationState> reader(in);
  std::vector<std::string> texts;
  for (int i = 0; i < 200 && texts.empty(); ++i) {
    usleep(10'000);
    reader.take_each([&](const wire::RegistrationState &sample, const auto &) { texts.emplace_back(sample.text); });
  }
  ASSERT_EQ(texts, std::vector<std::string>{"revision 3"});
}

TEST(Dds, EveryKindOfCommandKeepsItsBody) {
  const dds::Participant participant(own_domain());
  dds::Reader<wire::Command> reader(participant);
  const dds::Writer<wire::Command> writer(participant);
  wait_for_match(writer);

  wire::Command command{};
  ASSERT_TRUE(wire::set_name(command.client, "test"));
  command.id = 1;
  ASSERT_EQ(wire::fill_command(command, bregma_wire_COMMAND_LOAD_CASE, {"/cases/colin27"}), "");
  ASSERT_TRUE(writer.write(command));
  command.id = 2;
  ASSERT_EQ(wire::fill_command(command, bregma_wire_COMMAND_ACCEPT_REGISTRATION, {}), "");
  ASSERT_TRUE(writer.write(command));
  command.id = 3;
  ASSERT_EQ(wire::fill_command(command, bregma_wire_COMMAND_CAPTURE_FIDUCIAL, {"Stylus", "Nasion"}), "");
  ASSERT_TRUE(writer.write(command));

  std::vector<wire::Command> taken;
  for (int i = 0; i < 200 && taken.size() < 3; ++i) {
    usleep(10'000);
    reader.take_each([&](const wire::Command &sample, const auto &) { taken.push_back(sample); });
  }
  ASSERT_EQ(taken.size(), 3U);
  EXPECT_STREQ(taken[0].body._u.folder.folder, "/cases/colin27");
  EXPECT_EQ(taken[1].kind, bregma_wire_COMMAND_ACCEPT_REGISTRATION);
  EXPECT_EQ(taken[1].body._d, bregma_wire_FORM_EMPTY);
  EXPECT_EQ(wire::view(taken[2].body._u.touch.point), "Nasion");
}

TEST(Dds, SilentWriterMissesItsDeadlineAndALostWriterIsCounted) {
  const dds::Participant in(own_domain());
  dds::Reader<wire::TrackerFrame> reader(in);
  dds::WaitSet wait(in);
  wait.attach(reader);
  {
    const dds::Participant out(own_domain());
    const dds::Writer<wire::TrackerFrame> writer(out);
    wait_for_match(writer);
    wire::TrackerFrame frame{};
    ASSERT_TRUE(wire::set_name(frame.device, "Tracker"));
    ASSERT_TRUE(writer.write(frame));
    for (int i = 0; i < 100 && reader.status().deadlines_missed == 0; ++i) {
      wait.wait(20ms);
      reader.take_each([](const auto &, const auto &) {});
    }
    EXPECT_GT(reader.status().deadlines_missed, 0U);
    EXPECT_EQ(reader.status().writers_alive, 1U);
    EXPECT_EQ(reader.status().writers_lost, 0U);
  }
  for (int i = 0; i < 200 && reader.status().writers_lost == 0; ++i) {
    wait.wait(20ms);
  }
  EXPECT_EQ(reader.status().writers_lost, 1U);
  EXPECT_EQ(reader.status().writers_alive, 0U);
}

TEST(Dds, GuardWakesAWaitSet) {
  const dds::Participant participant(own_domain());
  const dds::Guard guard(participant);
  dds::WaitSet wait(participant);
  wait.attach(guard);
  EXPECT_FALSE(wait.wait(1ms));
  guard.raise();
  EXPECT_TRUE(wait.wait(1s));
  guard.lower();
  EXPECT_FALSE(wait.wait(1ms));
}

TEST(Dds, DomainThatCannotExistIsRefusedWithItsNumber) {
  try {
    const dds::Participant participant(100'000);
    FAIL() << "domain 100000 was joined";
  } catch (const dds::Error &error) {
    EXPECT_NE(std::string(error.what()).find("100000"), std::string::npos) << error.what();
  }
}

TEST(Names, ALongNameIsRejectedNotTruncated) {
  wire::Name name{};
  EXPECT_TRUE(wire::set_name(name, std::string(31, 'a')));
  EXPECT_FALSE(wire::set_name(name, std::string(32, 'b')));
  EXPECT_EQ(wire::view(name), std::string(31, 'a'));
}

TEST(Names, ALongTextIsTruncatedWithDots) {
  char text[16] = {};
  wire::set_text(text, "a text that is too long");
  EXPECT_STREQ(text, "a text that ...");
}

} // namespace
