#include "server/session/alarm_registry.hpp"

#include <vector>

#include <gtest/gtest.h>

#include "idl/names.hpp"

namespace bregma::server {
namespace {

class AlarmRegistryTest : public ::testing::Test {
protected:
  bool update(const char *kind, const char *subject, bool active, std::int64_t time_ns,
              wire::AlarmSeverity severity = bregma_wire_SEVERITY_CRITICAL, const char *text = "why") {
    AlarmCondition condition{};
    EXPECT_TRUE(wire::set_name(condition.kind, kind) && wire::set_name(condition.subject, subject));
    condition.active = active;
    condition.severity = severity;
    condition.time_ns = time_ns;
    wire::set_text(condition.text, text);
    return registry.update(condition);
  }
  std::vector<wire::Alarm> published;
  AlarmRegistry registry{[this](const wire::Alarm &alarm) { published.push_back(alarm); }};
};

TEST_F(AlarmRegistryTest, RaisedAcknowledgedClearedAndRaisedAgain) {
  EXPECT_FALSE(update("drift", "Reference", false, 1)) << "the end of what never began";
  EXPECT_TRUE(update("drift", "Reference", true, 10));
  EXPECT_FALSE(update("drift", "Reference", true, 11));
  ASSERT_EQ(published.size(), 1U);
  EXPECT_EQ(published[0].state, bregma_wire_ALARM_RAISED);
  EXPECT_EQ(published[0].count, 1U);
  EXPECT_EQ(published[0].raised_time_ns, 10);
  EXPECT_STREQ(published[0].text, "why");
  EXPECT_TRUE(registry.unacknowledged("drift"));

  EXPECT_FALSE(registry.acknowledge("drift", "Reference", 20));
  EXPECT_FALSE(registry.acknowledge("drift", "Reference", 21)) << "again does no harm";
  ASSERT_EQ(published.size(), 2U);
  EXPECT_EQ(published[1].state, bregma_wire_ALARM_ACKNOWLEDGED);
  EXPECT_EQ(published[1].changed_time_ns, 20);
  EXPECT_EQ(published[1].raised_time_ns, 10);
  EXPECT_TRUE(registry.active("drift"));
  EXPECT_FALSE(registry.unacknowledged("drift"));
  EXPECT_FALSE(update("drift", "Reference", true, 25)) << "acknowledged, and the condition still holds";

  EXPECT_TRUE(update("drift", "Reference", false, 30));
  EXPECT_EQ(published.back().state, bregma_wire_ALARM_CLEARED);
  EXPECT_FALSE(registry.active("drift"));
  EXPECT_TRUE(update("drift", "Reference", true, 40));
  EXPECT_EQ(published.back().state, bregma_wire_ALARM_RAISED);
  EXPECT_EQ(published.back().count, 2U);
  EXPECT_EQ(published.back().raised_time_ns, 40);
  EXPECT_EQ(published.size(), 4U);
}

TEST_F(AlarmRegistryTest, AHigherSeverityRaisesAnAcknowledgedAlarmAgain) {
  update("disk", "", true, 1, bregma_wire_SEVERITY_WARNING, "1 GB left");
  EXPECT_FALSE(registry.acknowledge("disk", "", 2));
  EXPECT_FALSE(update("disk", "", true, 3, bregma_wire_SEVERITY_CRITICAL, "full"));
  EXPECT_EQ(published.back().state, bregma_wire_ALARM_RAISED);
  EXPECT_EQ(published.back().severity, bregma_wire_SEVERITY_CRITICAL);
  EXPECT_EQ(published.back().count, 1U) << "the same alarm";
  EXPECT_STREQ(published.back().text, "full");
}

TEST_F(AlarmRegistryTest, SubjectsHaveSeparateAlarms) {
  update("device_lost", "Robot", true, 1);
  update("device_lost", "Force", true, 2);
  EXPECT_EQ(*registry.acknowledge("device_lost", "Range", 3),
            "no alarm device_lost of Range is raised; raised: device_lost of Force, device_lost of Robot");
  EXPECT_FALSE(registry.acknowledge("device_lost", "Robot", 4));
  EXPECT_TRUE(registry.unacknowledged("device_lost"));
  update("device_lost", "Robot", false, 5);
  update("device_lost", "Force", false, 6);
  EXPECT_EQ(*registry.acknowledge("device_lost", "Robot", 7), "no alarm device_lost of Robot is raised; none is");
}

TEST_F(AlarmRegistryTest, WithItsCaseAClearedAlarmEndsAtOnceAndARaisedOneWhenItIsCleared) {
  update("drift", "Reference", true, 1);
  update("drift", "Reference", false, 2);
  update("device_lost", "Robot", true, 3);
  published.clear();
  registry.case_closed(4);
  ASSERT_EQ(published.size(), 1U);
  EXPECT_EQ(wire::view(published[0].kind), "drift");
  EXPECT_EQ(published[0].state, bregma_wire_ALARM_CLEARED);
  EXPECT_TRUE(published[0].ended);
  EXPECT_TRUE(registry.unacknowledged("device_lost")) << "the robot is still lost";

  EXPECT_TRUE(update("device_lost", "Robot", false, 5));
  EXPECT_EQ(published.back().state, bregma_wire_ALARM_CLEARED);
  EXPECT_TRUE(published.back().ended);
  published.clear();
  registry.case_closed(6);
  EXPECT_TRUE(published.empty()) << "nothing is left in the registry";

  update("drift", "Reference", true, 7);
  EXPECT_EQ(published.back().count, 1U) << "of the next case";
  EXPECT_FALSE(published.back().ended);
}

} // namespace
} // namespace bregma::server
