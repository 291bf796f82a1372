#include "server/stages/echo/stage.hpp"

#include <gtest/gtest.h>

#include "server/stages/host.hpp"
#include "tests/support/memory_topics.hpp"

namespace bregma::server {
namespace {

TEST(EchoStage, PassesOnItsInput) {
  test::MemoryTopics topics;
  Host host;
  EchoStage echo({.rate_hz = 100.0}, {topics.link(EchoStage::kName), host});
  runtime::LatestValue<ProbeView> source;
  echo.connect(source);
  echo.step({});
  EXPECT_FALSE(echo.probe.load());
  source.store({.live = true, .acquired_ns = 7});
  echo.step({});
  ASSERT_TRUE(echo.probe.load());
  EXPECT_EQ(echo.probe.load()->acquired_ns, 7);
  echo.step({});
  EXPECT_EQ(echo.probe.count(), 1U); // once per value
}

TEST(EchoStage, IsOffUntilItIsGivenARate) { EXPECT_EQ(EchoParameters{}.rate_hz, 0.0); }

} // namespace
} // namespace bregma::server
