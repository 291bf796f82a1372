// Programs of different revisions on one bus: samples of an earlier and of a later revision, read with the types of
// this program and vice versa, and types that cannot be extended. The rules are in docs/wire.md.
#include <atomic>
#include <chrono>
#include <cstring>
#include <optional>
#include <string_view>

#include <gtest/gtest.h>
#include <unistd.h>

#include "earlier.h"
#include "idl/commands.hpp"
#include "idl/dds.hpp"
#include "idl/names.hpp"
#include "idl/peers.hpp"
#include "idl/version.hpp"
#include "later.h"

#define TEST_TOPIC(Type, name)                                                                                         \
  template <> struct bregma::wire::Topic<Type> {                                                                       \
    static constexpr const char *kName = name;                                                                         \
    static constexpr Qos kQos = qos::kControl;                                                                         \
    static const dds_topic_descriptor_t &descriptor() { return Type##_desc; }                                          \
  }
TEST_TOPIC(earlier_TrackerFrame, "TrackerFrame");
TEST_TOPIC(later_TrackerFrame, "TrackerFrame");
TEST_TOPIC(earlier_RangeSample, "RangeSample");
TEST_TOPIC(earlier_Command, "Command");
TEST_TOPIC(later_Command, "Command");
TEST_TOPIC(later_Alarm, "Alarm");
TEST_TOPIC(earlier_FinalStruct, "FinalStruct");
TEST_TOPIC(later_FinalStruct, "FinalStruct");
TEST_TOPIC(earlier_FixedArray, "FixedArray");
TEST_TOPIC(later_FixedArray, "FixedArray");
TEST_TOPIC(earlier_PlainEnum, "PlainEnum");
TEST_TOPIC(later_PlainEnum, "PlainEnum");

namespace {

using namespace bregma;
using namespace std::chrono_literals;

std::uint32_t own_domain() { return 100 + static_cast<std::uint32_t>(getpid()) % 100; }

// Two programs on one topic, with different types.
template <class Written, class Read> struct Bus {
  dds::Participant out{own_domain()};
  dds::Participant in{own_domain()};
  dds::Writer<Written> writer{out, wire::qos::kControl};
  dds::Reader<Read> reader{in, wire::qos::kControl};

  [[nodiscard]] bool matched(std::chrono::milliseconds patience = 5s) const {
    const auto end = std::chrono::steady_clock::now() + patience;
    while (std::chrono::steady_clock::now() < end) {
      if (writer.matched_readers() > 0 && reader.matched_writers() > 0) {
        return true;
      }
      usleep(10'000);
    }
    return false;
  }
  // The sample as the other program reads it.
  [[nodiscard]] std::optional<Read> pass(const Written &sample) {
    std::optional<Read> out_sample;
    if (!matched() || !writer.write(sample)) {
      return out_sample;
    }
    for (int i = 0; i < 300 && !out_sample; ++i) {
      usleep(10'000);
      reader.take_each([&](const Read &read, const auto &) { out_sample = read; }); // a shallow copy
    }
    return out_sample;
  }
};

template <class Frame> Frame frame_with_tools() {
  Frame frame{};
  (void)wire::set_name(frame.device, "Tracker");
  frame.frame = 7;
  frame.tool_count = 12;
  for (std::uint32_t i = 0; i < 12; ++i) {
    (void)wire::set_name(frame.tools[i].tool, "Tool" + std::to_string(i));
    frame.tools[i].status = bregma_wire_TOOL_VISIBLE;
    frame.tools[i].T_tracker_tool = {{1, 0, 0, 0}, {1.0 * i, 2.0, 3.0}};
  }
  return frame;
}

template <class Frame> void expect_tools(const Frame &frame) {
  EXPECT_EQ(frame.frame, 7U);
  ASSERT_EQ(frame.tool_count, 12U);
  for (std::uint32_t i = 0; i < 12; ++i) {
    EXPECT_EQ(wire::view(frame.tools[i].tool), "Tool" + std::to_string(i));
    EXPECT_EQ(frame.tools[i].T_tracker_tool.translation_mm[0], 1.0 * i);
    EXPECT_EQ(frame.tools[i].T_tracker_tool.translation_mm[2], 3.0);
  }
}

TEST(Evolution, AnEarlierFrameHasZerosWhereItHasNoFields) {
  Bus<earlier_TrackerFrame, wire::TrackerFrame> bus;
  const auto read = bus.pass(frame_with_tools<earlier_TrackerFrame>());
  ASSERT_TRUE(read);
  expect_tools(*read);
  for (const wire::TrackedTool &tool : read->tools) {
    EXPECT_EQ(tool.marker_rms_mm, 0.0);
    for (const float entry : tool.covariance) {
      EXPECT_EQ(entry, 0.0F);
    }
  }
}

TEST(Evolution, ALaterFrameIsReadWithoutItsAdditionalFields) {
  Bus<later_TrackerFrame, wire::TrackerFrame> bus;
  auto sent = frame_with_tools<later_TrackerFrame>();
  std::uint8_t notes[5] = {1, 2, 3, 4, 5};
  sent.notes = {5, 5, notes, false};
  for (auto &tool : sent.tools) {
    tool.temperature_K = 300.0;
    tool.marker_rms_mm = 0.25;
    tool.covariance[20] = 4.0F;
  }
  sent.tools[3].status = later_TOOL_OVEREXPOSED;
  const auto read = bus.pass(sent);
  ASSERT_TRUE(read);
  expect_tools(*read);
  EXPECT_EQ(read->tools[11].marker_rms_mm, 0.25);
  EXPECT_EQ(read->tools[11].covariance[20], 4.0F);
  EXPECT_EQ(read->tools[3].status, 5) << "a constant that this program does not know arrives as it is";
}

TEST(Evolution, OurFrameIsReadByBothOthers) {
  auto sent = frame_with_tools<wire::TrackerFrame>();
  sent.tools[11].marker_rms_mm = 0.5;
  Bus<wire::TrackerFrame, earlier_TrackerFrame> to_earlier;
  const auto earlier = to_earlier.pass(sent);
  ASSERT_TRUE(earlier);
  expect_tools(*earlier);
  Bus<wire::TrackerFrame, later_TrackerFrame> to_later;
  const auto later = to_later.pass(sent);
  ASSERT_TRUE(later);
  expect_tools(*later);
  EXPECT_EQ(later->tools[11].marker_rms_mm, 0.5);
  EXPECT_EQ(later->tools[11].temperature_K, 0.0);
  EXPECT_EQ(later->exposure_ns, 0);
  EXPECT_EQ(later->notes._length, 0U);
}

TEST(Evolution, AReadingWithoutAStatusIsUnknownAndNotValid) {
  Bus<earlier_RangeSample, wire::RangeSample> bus;
  earlier_RangeSample sent{};
  (void)wire::set_name(sent.device, "Range");
  sent.range_mm = 120.0;
  const auto read = bus.pass(sent);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->range_mm, 120.0);
  EXPECT_EQ(read->status, bregma_wire_RANGE_UNKNOWN);
}

TEST(Evolution, ACommandOfALaterRevisionArrivesWithItsKindSoThatItCanBeRefused) {
  Bus<later_Command, wire::Command> bus;
  later_Command sent{};
  (void)wire::set_name(sent.client, "new-client");
  sent.id = 5;
  sent.kind = later_COMMAND_DRILL;
  sent.body._d = later_FORM_DRILL;
  (void)wire::set_name(sent.body._u.drill.device, "Drill");
  wire::set_text(sent.body._u.drill.reason, "to show it");
  (void)wire::set_name(sent.receiver, "Arm");
  const auto read = bus.pass(sent);
  ASSERT_TRUE(read);
  EXPECT_EQ(wire::view(read->client), "new-client");
  EXPECT_EQ(read->id, 5U);
  EXPECT_EQ(wire::command_name(read->kind), "command 1027");
  EXPECT_EQ(read->body._d, 14);
  EXPECT_EQ(wire::view(read->receiver), "Arm") << "what follows a body of an unknown form is read";
  EXPECT_EQ(wire::malformed(*read), "command 1027 is not known");
}

TEST(Evolution, ACommandOfAnEarlierRevisionIsExecuted) {
  Bus<earlier_Command, wire::Command> bus;
  earlier_Command sent{};
  (void)wire::set_name(sent.client, "old-client");
  sent.kind = bregma_wire_COMMAND_START_PIVOT;
  sent.body._d = bregma_wire_FORM_TOOL;
  (void)wire::set_name(sent.body._u.tool.tool, "Stylus");
  const auto read = bus.pass(sent);
  ASSERT_TRUE(read);
  EXPECT_EQ(wire::malformed(*read), "");
  EXPECT_EQ(wire::view(read->body._u.tool.tool), "Stylus");
  EXPECT_EQ(wire::view(read->receiver), "") << "to the daemon";
}

TEST(Evolution, OurCommandIsReadByBothOthers) {
  wire::Command sent{};
  (void)wire::set_name(sent.client, "client");
  ASSERT_EQ(wire::fill_command(sent, bregma_wire_COMMAND_START_PIVOT, {"Stylus"}), "");
  Bus<wire::Command, earlier_Command> to_earlier;
  const auto earlier = to_earlier.pass(sent);
  ASSERT_TRUE(earlier);
  EXPECT_EQ(wire::view(earlier->body._u.tool.tool), "Stylus");
  Bus<wire::Command, later_Command> to_later;
  const auto later = to_later.pass(sent);
  ASSERT_TRUE(later);
  EXPECT_EQ(wire::view(later->body._u.tool.tool), "Stylus");
  EXPECT_EQ(later->body._u.tool.speed, 0.0);

  // A form that the earlier revision does not contain.
  ASSERT_EQ(wire::fill_command(sent, bregma_wire_COMMAND_CHECK_TOUCH, {"Stylus", "Nasion"}), "");
  const auto unknown = to_earlier.pass(sent);
  ASSERT_TRUE(unknown);
  EXPECT_EQ(unknown->kind, bregma_wire_COMMAND_CHECK_TOUCH);
  EXPECT_EQ(unknown->body._d, bregma_wire_FORM_TOUCH);
}

TEST(Evolution, AnAlarmInALaterStateArrives) {
  Bus<later_Alarm, wire::Alarm> bus;
  later_Alarm sent{};
  (void)wire::set_name(sent.kind, "drift");
  sent.state = later_ALARM_SHELVED;
  sent.severity = bregma_wire_SEVERITY_CRITICAL;
  wire::set_text(sent.text, "moved");
  wire::set_text(sent.advice, "check the landmarks");
  const auto read = bus.pass(sent);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->state, 4);
  EXPECT_EQ(read->severity, bregma_wire_SEVERITY_CRITICAL);
  EXPECT_STREQ(read->text, "moved");
}

// Such a change makes a new generation: both sides see no peer on the topic, and only the version gives the reason.
TEST(Evolution, TypesThatCannotGrowDoNotMatch) {
  EXPECT_TRUE((Bus<earlier_FinalStruct, earlier_FinalStruct>().matched())) << "with itself it does";
  EXPECT_FALSE((Bus<later_FinalStruct, earlier_FinalStruct>().matched(500ms))) << "a field more in a @final struct";
  EXPECT_FALSE((Bus<earlier_FinalStruct, later_FinalStruct>().matched(500ms)));
  EXPECT_FALSE((Bus<later_FixedArray, earlier_FixedArray>().matched(500ms))) << "a longer array";
  EXPECT_FALSE((Bus<later_PlainEnum, earlier_PlainEnum>().matched(500ms))) << "an enumerator more";
}

// A writer of another type that states no type, as a program of another vendor may.
dds_topic_descriptor_t untyped_descriptor_named(const char *type) {
  const dds_topic_descriptor_t &from = earlier_FinalStruct_desc;
  const std::uint32_t flags =
      (from.m_flagset & ~std::uint32_t{DDS_TOPIC_XTYPES_METADATA}) | DDS_TOPIC_RESTRICT_DATA_REPRESENTATION;
  return {from.m_size, from.m_align, flags,       from.m_nkeys, type,         from.m_keys,
          from.m_nops, from.m_ops,   from.m_meta, {nullptr, 0}, {nullptr, 0}, DDS_DATA_REPRESENTATION_FLAG_XCDR2};
}

TEST(Evolution, SamplesThatAreNotOfTheirTopicsTypeAreCountedAndLogged) {
  const auto descriptor = untyped_descriptor_named(wire::Topic<wire::ForceSample>::descriptor().m_typename);
  const dds::Participant ours(own_domain());
  dds::Reader<wire::ForceSample> reader(ours);
  std::atomic<int> logged{0};
  dds::set_log([&](dds::Severity, std::string_view line) {
    logged += line.find("ForceSample failed") != std::string_view::npos ? 1 : 0;
  });
  const dds::Participant other(own_domain());
  const dds::Entity writer = dds::untyped::make_writer(other, descriptor, "ForceSample", wire::qos::kSensor);
  for (int i = 0; i < 500 && dds::untyped::matched_readers(writer) == 0; ++i) {
    usleep(10'000);
  }
  EXPECT_EQ(ours.mismatches().text(), "");
  const std::uint64_t before = dds::ill_typed_samples();
  earlier_FinalStruct sample{};
  std::memset(&sample, 0x7f, sizeof sample);
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(dds::untyped::write(writer, &sample));
  }
  for (int i = 0; i < 500 && dds::ill_typed_samples() < before + 5; ++i) {
    usleep(10'000);
  }
  EXPECT_EQ(dds::ill_typed_samples(), before + 5);
  EXPECT_EQ(logged, 5);
  EXPECT_EQ(reader.take_each([](const auto &, const auto &) {}), 0U);
  dds::set_log([](dds::Severity, std::string_view) {});
}

TEST(WireVersion, IsAnnouncedAndReadBack) {
  const auto back = wire::from_user_data(wire::to_user_data({{3, 14}, "bregma-gateway"}));
  ASSERT_TRUE(back);
  EXPECT_EQ(back->version, (wire::WireVersion{3, 14}));
  EXPECT_EQ(back->program, "bregma-gateway");
  EXPECT_EQ(wire::to_user_data({{2, 0}, "x"}), "bregma.wire=2.0;program=x");
  EXPECT_EQ(wire::from_user_data("bregma.wire=2.7;program=a;site=b")->program, "a") << "more may follow";
  for (const char *none : {"", "bregma.wire=", "bregma.wire=2", "bregma.wire=2.", "bregma.wire=x.1", "wire=2.0"}) {
    EXPECT_FALSE(wire::from_user_data(none)) << none;
  }
  EXPECT_EQ(wire::version_from("2.6"), wire::kWireVersion);
  EXPECT_FALSE(wire::version_from("2.6 "));
}

TEST(Peers, NameParticipantsOfAnotherGenerationWhileTheyArePresent) {
  const dds::Participant ours(own_domain());
  dds::Peers peers(ours);
  const auto text_becomes = [&](const std::string &wanted) {
    std::string text;
    for (int i = 0; i < 500; ++i) {
      peers.update();
      text = dds::other_wire_text(peers.of_another_wire());
      if (text == wanted) {
        break;
      }
      usleep(10'000);
    }
    return text;
  };
  const std::string end =
      ", this program speaks wire " + wire::text_of(wire::kWireVersion) + ": install one release on both";
  {
    // A revision of the same generation is not reported, and neither is a program without a topic of Bregma.
    const dds::Participant revision(own_domain(), {{2, 9}, "newer"});
    const dds::Writer<wire::SystemHealth> understood(revision);
    const dds::Participant bystander(own_domain(), {{1, 0}, "bystander"});
    const dds::Participant driver(own_domain(), {{1, 0}, "old\ndriver"});
    const dds::Writer<wire::TrackerFrame> frames(driver);
    EXPECT_EQ(text_becomes("old?driver speaks wire 1.0" + end), "old?driver speaks wire 1.0" + end);
    ASSERT_EQ(peers.of_another_wire().size(), 1U);
    EXPECT_FALSE(peers.of_another_wire().front().is_daemon);
  }
  EXPECT_EQ(text_becomes(""), "") << "they have gone";
  const dds::Participant old(own_domain(), {{1, 0}, "bregmad"});
  const dds::Writer<wire::SystemHealth> health(old);
  EXPECT_EQ(text_becomes("bregmad speaks wire 1.0" + end), "bregmad speaks wire 1.0" + end);
  EXPECT_TRUE(peers.of_another_wire().front().is_daemon);
}

TEST(Commands, EveryRowOfTheTableCanBeFilledCheckedAndNamed) {
  for (const wire::CommandEntry &entry : wire::kCommands) {
    EXPECT_EQ(wire::find_command(entry.kind), &entry) << entry.name << ": a kind has one row";
    const auto fields = wire::fields_of(entry.form);
    EXPECT_EQ(fields.empty(), entry.form == bregma_wire_FORM_EMPTY) << entry.name;
    const std::vector<std::string_view> values(fields.size(), "5");
    wire::Command command{};
    EXPECT_EQ(wire::fill_command(command, entry.kind, values), "") << entry.name;
    EXPECT_EQ(wire::malformed(command), "") << entry.name;
    EXPECT_EQ(wire::command_name(entry.kind), entry.name);
    command.body._d = 99;
    EXPECT_EQ(wire::malformed(command),
              std::string(entry.name) + " has a body of form 99, not " + std::to_string(entry.form));
  }
  EXPECT_EQ(wire::kCommands.size(), std::size_t{bregma_wire_COMMAND_RESET_SCANNER_REGISTRATION})
      << "the kinds of control.idl";
}

TEST(Commands, InvalidValuesAreNamed) {
  wire::Command command{};
  EXPECT_EQ(wire::fill_command(command, 99, {}), "command 99 is not known");
  EXPECT_EQ(wire::fill_command(command, bregma_wire_COMMAND_CLOSE_CASE, {"x"}), "CLOSE_CASE takes 0 values, not 1");
  EXPECT_EQ(wire::fill_command(command, bregma_wire_COMMAND_LOAD_CASE, {}), "case folder is empty");
  EXPECT_EQ(wire::fill_command(command, bregma_wire_COMMAND_SET_COILS, {"Coils", "top", "75x", "5"}),
            "current_mA '75x' is not a number");
  EXPECT_EQ(wire::fill_command(command, bregma_wire_COMMAND_ACQUIRE_SERIES, {"MR", "t1", "-1"}),
            "slices '-1' is not a number");
  ASSERT_EQ(wire::fill_command(command, bregma_wire_COMMAND_SET_COILS, {"Coils", "top", "-75.5", "5"}), "");
  EXPECT_EQ(command.body._u.coils.current_mA, -75.5);
  command.body._u.coils.hold_s = std::numeric_limits<double>::infinity();
  EXPECT_EQ(wire::malformed(command), "hold_s is not a finite number");
}

} // namespace
