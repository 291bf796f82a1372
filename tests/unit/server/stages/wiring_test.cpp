#include "server/wiring.hpp"

#include <set>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "server/config.hpp"
#include "server/stages/echo/stage.hpp"
#include "server/stages/navigation/stage.hpp"
#include "tests/support/memory_topics.hpp"

namespace bregma::server {
namespace {

TEST(Wiring, HasEveryStageOnceAndStartsThoseWithARate) {
  test::MemoryTopics topics;
  Host host;
  Config config;
  const Wiring wiring(config.stages, topics, host);
  std::set<std::string> names;
  for (const Stage *stage : wiring.stages()) {
    EXPECT_TRUE(names.insert(stage->name()).second) << stage->name();
    EXPECT_LE(std::string(stage->name()).size(), 15U) << stage->name(); // the kernel's limit of a thread's name
    EXPECT_EQ(wiring.find(stage->name()), stage);
  }
  EXPECT_TRUE(names.contains("navigation"));
  EXPECT_FALSE(names.contains("echo")); // it has no rate
  EXPECT_NE(wiring.find("echo"), nullptr);
  EXPECT_EQ(wiring.find("no such stage"), nullptr);
}

TEST(Wiring, AStageWithARateIsStarted) {
  test::MemoryTopics topics;
  Host host;
  Config config;
  config.stages.of<EchoParameters>().rate_hz = 100.0;
  const Wiring wiring(config.stages, topics, host);
  EXPECT_NE(std::find(wiring.stages().begin(), wiring.stages().end(), wiring.find("echo")), wiring.stages().end());
}

TEST(Wiring, RefusesParametersWithTheKeyAndTheValue) {
  test::MemoryTopics topics;
  Host host;
  Config config;
  config.stages.of<NavigationParameters>().trackers = "A,A";
  try {
    const Wiring wiring(config.stages, topics, host);
    FAIL() << "two devices of one name were taken";
  } catch (const std::invalid_argument &error) {
    EXPECT_STREQ(error.what(), "devices.trackers = \"A,A\": \"A\" is named twice");
  }
}

} // namespace
} // namespace bregma::server
