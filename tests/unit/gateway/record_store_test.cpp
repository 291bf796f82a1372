#include "clients/gateway/record_store.hpp"

#include <array>
#include <cmath>
#include <cstring>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "clients/gateway/layout.hpp"
#include "idl/boot_clock.hpp"
#include "idl/topics.hpp"

namespace bregma::gateway {
namespace {

constexpr std::array kTools{RecordKind::kTool};
constexpr std::array kAlarms{RecordKind::kAlarm};
constexpr std::array kFields{RecordKind::kField};

Record tool(const char *name, double x, double valid_until_ms = 1e9) {
  Tool out{};
  std::strcpy(out.tool, name);
  out.status = bregma_wire_POSE_LIVE;
  out.tip_mm[0] = x;
  out.valid_until_ms = valid_until_ms;
  return make_record(RecordKind::kTool, out);
}

Record alarm(const char *name) {
  Alarm out{};
  std::strcpy(out.alarm, name);
  return make_record(RecordKind::kAlarm, out);
}

nlohmann::json records_of(const std::optional<Frame> &frame) {
  return frame ? frame_json(frame->bytes)["records"] : nlohmann::json::array();
}

TEST(RecordStore, TheFirstFrameHasEverythingAndTheNextWhatHasChanged) {
  RecordStore store;
  EXPECT_FALSE(store.next({}));
  EXPECT_TRUE(store.replace(kTools, {tool("Probe", 1), tool("Pointer", 2)}));
  const auto first = store.next({.number = 1});
  EXPECT_EQ(records_of(first).size(), 2U);
  EXPECT_FALSE(store.next({.after = first->up_to}));
  EXPECT_TRUE(store.replace(kTools, {tool("Probe", 3), tool("Pointer", 2)}));
  const auto second = records_of(store.next({.after = first->up_to}));
  ASSERT_EQ(second.size(), 1U);
  EXPECT_EQ(second[0]["tool"], "Probe");
  EXPECT_EQ(second[0]["tip_mm"][0], 3.0);
}

TEST(RecordStore, TheSameRecordIsNoNews) {
  RecordStore store;
  EXPECT_TRUE(store.replace(kTools, {tool("Probe", 1)}));
  EXPECT_FALSE(store.replace(kTools, {tool("Probe", 1)}));
}

TEST(RecordStore, AClientThatStandsStillGetsTheLatestValueOnceAndCostsNothing) {
  RecordStore store;
  (void)store.replace(kTools, {tool("Probe", 0)});
  const auto first = store.next({});
  for (int i = 1; i <= 100'000; ++i) {
    (void)store.replace(kTools, {tool("Probe", i)});
  }
  EXPECT_EQ(store.instances(), 1U);
  const auto records = records_of(store.next({.after = first->up_to}));
  ASSERT_EQ(records.size(), 1U);
  EXPECT_EQ(records[0]["tip_mm"][0], 100'000.0);
}

TEST(RecordStore, AMissingInstanceEndsForClientsThatKnowItAndIsForgottenWhenAllDo) {
  RecordStore store;
  (void)store.replace(kAlarms, {alarm("drift"), alarm("disk")});
  (void)store.replace(kTools, {tool("Probe", 1)});
  const auto first = store.next({});
  EXPECT_TRUE(store.replace(kAlarms, {alarm("disk")}));
  const auto ended = store.next({.after = first->up_to});
  ASSERT_EQ(records_of(ended).size(), 1U);
  EXPECT_EQ(records_of(ended)[0]["ended"], true);
  EXPECT_EQ(records_of(ended)[0]["alarm"], "drift");
  EXPECT_EQ(records_of(store.next({})).size(), 2U) << "a new client has never heard of it";

  store.forget_ended(first->up_to);
  EXPECT_EQ(store.instances(), 3U);
  store.forget_ended(ended->up_to);
  EXPECT_EQ(store.instances(), 2U);
  EXPECT_TRUE(store.replace(kAlarms, {alarm("disk"), alarm("drift")})) << "it may come back";
}

TEST(RecordStore, APoseThatIsOverWhenItIsSentIsSentWithoutThePose) {
  RecordStore store;
  (void)store.replace(kTools, {tool("Probe", 1, 500.0)});
  const auto live = records_of(store.next({.now_ns = 499'999'999}));
  EXPECT_EQ(live[0]["status"], bregma_wire_POSE_LIVE);
  const auto over = records_of(store.next({.now_ns = 500'000'000}));
  EXPECT_EQ(over[0]["status"], bregma_wire_POSE_STALE);
  EXPECT_TRUE(over[0]["valid_until_ms"].is_null());
  for (const char *field : {"tip_mm", "rotation", "covariance", "tre_95_axes"}) {
    for (const auto &value : over[0][field]) {
      EXPECT_TRUE(value.is_null()) << field;
    }
  }
}

TEST(RecordStore, AFrameIsBoundedAndTheRestFollows) {
  RecordStore store;
  std::vector<Record> records;
  for (int i = 0; i < 2000; ++i) {
    records.push_back(tool(("T" + std::to_string(i)).c_str(), i));
  }
  (void)store.replace(kTools, records);
  std::uint64_t seen = 0;
  std::size_t received = 0;
  int frames = 0;
  while (const auto frame = store.next({.after = seen})) {
    EXPECT_LE(frame->bytes.size(), RecordStore::kMaxFrameBytes + sizeof(RecordHeader) + sizeof(Tool));
    received += records_of(frame).size();
    seen = frame->up_to;
    ++frames;
  }
  EXPECT_EQ(received, 2000U);
  EXPECT_GT(frames, 1);
}

TEST(RecordStore, AFieldIsSentToThoseWhoWantItWithItsArrays) {
  RecordStore store;
  FieldHeader header{};
  header.nodes = 2;
  header.stresses = 1;
  const std::array<float, 6> displacement{1, 2, 3, 4, 5, NAN};
  const std::array<float, 1> stress{7};
  (void)store.replace(kFields, {make_field_record(header, displacement, stress)});
  EXPECT_FALSE(store.next({}));
  const auto records = records_of(store.next({.field = true}));
  ASSERT_EQ(records.size(), 1U);
  EXPECT_EQ(records[0]["displacement_mm"], nlohmann::json::parse("[1.0, 2.0, 3.0, 4.0, 5.0, null]"));
  EXPECT_EQ(records[0]["von_mises_Pa"], nlohmann::json::parse("[7.0]"));
}

TEST(RecordStore, ASliceIsSentToThoseWhoWantItAlsoIfItCameBefore) {
  constexpr std::array kSlices{RecordKind::kSlice};
  RecordStore store;
  SliceHeader header{};
  header.columns = 3;
  header.rows = 1;
  const std::array<std::uint16_t, 3> pixels{0, 4095, 65535};
  (void)store.replace(kTools, {tool("Probe", 1)});
  (void)store.replace(kSlices, {make_slice_record(header, pixels)});
  (void)store.replace(kTools, {tool("Probe", 2)});
  const auto first = store.next({});
  ASSERT_TRUE(first);
  EXPECT_EQ(records_of(first).size(), 1U) << "nobody asked for slices";
  const FrameRequest later{.after = store.before(RecordKind::kSlice), .slices = true};
  ASSERT_LT(later.after, first->up_to);
  const auto sent = records_of(store.next(later)); // outlives the loop
  for (const auto &record : sent) {
    if (record["kind"] == "slice") {
      EXPECT_EQ(record["pixels"], nlohmann::json::parse("[0, 4095, 65535]"));
      EXPECT_EQ(record["columns"], 3);
      return;
    }
  }
  FAIL() << "no slice";
}

TEST(RecordStore, OtherNewsWaitsForATool) {
  constexpr std::array kLinks{RecordKind::kLink};
  RecordStore store;
  (void)store.replace(kTools, {tool("Probe", 1)});
  const std::uint64_t seen = store.newest();
  (void)store.replace(kLinks, {make_record(RecordKind::kLink, Link{})});
  const std::int64_t now_ns = wire::boot_now_ns();
  EXPECT_FALSE(store.next({.after = seen, .now_ns = now_ns}));
  EXPECT_EQ(records_of(store.next({.after = seen, .now_ns = now_ns + RecordStore::kQuiet_ns})).size(), 1U);
  (void)store.replace(kTools, {tool("Probe", 2)});
  EXPECT_EQ(records_of(store.next({.after = seen, .now_ns = now_ns})).size(), 2U);
}

TEST(RecordStore, AnAnswerToAPingIsAFrameWithoutNews) {
  const RecordStore store;
  const auto records = records_of(store.next({.now_ns = 3'000'000, .pong = Pong{1.0, 2.0, 0.0}}));
  ASSERT_EQ(records.size(), 1U);
  EXPECT_EQ(records[0],
            nlohmann::json::parse(R"({"kind": "pong", "client_ms": 1.0, "received_ms": 2.0, "written_ms": 3.0})"));
}

} // namespace
} // namespace bregma::gateway
