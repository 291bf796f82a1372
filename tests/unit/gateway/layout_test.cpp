#include "clients/gateway/layout.hpp"

#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace bregma::gateway {
namespace {

template <class T> std::vector<std::byte> record_of(RecordKind kind, const T &body, std::uint16_t flags = 0) {
  std::vector<std::byte> out(sizeof(RecordHeader) + sizeof(T));
  const RecordHeader header{static_cast<std::uint16_t>(kind), flags, static_cast<std::uint32_t>(out.size())};
  std::memcpy(out.data(), &header, sizeof header);
  std::memcpy(out.data() + sizeof header, &body, sizeof body);
  return out;
}

TEST(Layout, IsThatOfTheDocumentation) {
  std::ifstream file(BREGMA_SOURCE_DIR "/docs/gateway.md");
  std::stringstream text;
  text << file.rdbuf();
  const std::string tables = layout_markdown();
  EXPECT_NE(text.str().find(tables.substr(0, tables.size() - 1)), std::string::npos)
      << "docs/gateway.md differs from layout_markdown()";
}

TEST(Layout, ARecordInJsonHasItsFieldsByNameAndNullForNan) {
  Tool tool{};
  std::strcpy(tool.tool, "Probe");
  tool.status = 1;
  tool.tip_mm[0] = 1.5;
  tool.tip_mm[1] = -2.0;
  tool.tip_mm[2] = std::nan("");
  tool.valid_until_ms = std::nan("");
  const nlohmann::json json = record_json(record_of(RecordKind::kTool, tool));
  EXPECT_EQ(json["kind"], "tool");
  EXPECT_EQ(json["tool"], "Probe");
  EXPECT_EQ(json["status"], 1);
  EXPECT_EQ(json["tip_mm"], nlohmann::json::parse("[1.5, -2.0, null]"));
  EXPECT_TRUE(json["valid_until_ms"].is_null());
  EXPECT_EQ(json["covariance"].size(), 36U);
  EXPECT_FALSE(json.contains("ended"));
}

TEST(Layout, AnEndedInstanceInJsonHasItsKeyOnly) {
  Alarm alarm{};
  std::strcpy(alarm.alarm, "drift");
  const nlohmann::json json = record_json(record_of(RecordKind::kAlarm, alarm, kEnded));
  EXPECT_EQ(json, nlohmann::json::parse(R"({"kind": "alarm", "ended": true, "alarm": "drift", "subject": ""})"));
}

TEST(Layout, AWordThatARecordAlsoUsesForItsOwnKindIsNotLost) {
  Device device{};
  device.kind = 3;
  const nlohmann::json json = record_json(record_of(RecordKind::kDevice, device));
  EXPECT_EQ(json["kind"], "device");
  EXPECT_EQ(json["device_kind"], 3);
}

TEST(Layout, UnknownKindsHaveNoLayout) {
  EXPECT_EQ(find_layout(0), nullptr);
  EXPECT_EQ(find_layout(static_cast<std::uint16_t>(record_layouts().size() + 1)), nullptr);
}

} // namespace
} // namespace bregma::gateway
