#include "server/config.hpp"

#include <cstdlib>

#include <gtest/gtest.h>

#include "idl/topics.hpp"
#include "server/inputs/device_names.hpp"
#include "server/runtime/state_directory.hpp"
#include "server/stages/navigation/stage.hpp"
#include "server/stages/sensors/stage.hpp"
#include "server/stages/session/stage.hpp"

namespace bregma::server {
namespace {

std::string error_of(const std::string &toml) {
  Config config;
  auto set = declare(config);
  const auto loaded = set.load_text(toml, "bregmad.toml");
  return loaded ? "" : loaded.error().message;
}

TEST(Config, ThePrintedConfigurationIsReadBackUnchanged) {
  Config config;
  const std::string printed = declare(config).to_toml();
  Config other;
  auto set = declare(other);
  other.stages.of<SessionParameters>().capture_window_ms = 123.0;
  other.log.level = LogLevel::kError;
  const auto loaded = set.load_text(printed, "printed");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(set.to_toml(), printed);
  EXPECT_EQ(other.stages.of<SessionParameters>().capture_window_ms, 300.0);
  EXPECT_EQ(other.log.level, LogLevel::kInfo);
}

TEST(Config, ValuesAreStoredInTheirFields) {
  Config config;
  auto set = declare(config);
  const auto loaded = set.load_text("domain_id = 7\n[navigation]\nfloor_rate_hz = 25\n[log]\nlevel = \"debug\"\n"
                                    "[devices]\ntrackers = \"Vega, Polaris\"\n",
                                    "bregmad.toml");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(config.domain_id, 7);
  EXPECT_EQ(config.stages.of<NavigationParameters>().floor_rate_hz, 25.0);
  EXPECT_EQ(config.log.level, LogLevel::kDebug);
  EXPECT_EQ(inputs::split_names(config.stages.of<NavigationParameters>().trackers),
            (std::vector<std::string>{"Vega", "Polaris"}));
  EXPECT_TRUE(check(config));
}

TEST(Config, UnknownKeysAndWrongValuesAreRefusedByName) {
  EXPECT_NE(error_of("[navigation]\nflor_rate_hz = 50\n").find("flor_rate_hz"), std::string::npos);
  const std::string range = error_of("[registration]\nrate_hz = 0\n");
  EXPECT_NE(range.find("bregmad.toml:2"), std::string::npos) << range;
  EXPECT_NE(range.find("rate_hz"), std::string::npos) << range;
  EXPECT_NE(error_of("[log]\nlevel = \"loud\"\n").find("loud"), std::string::npos);
}

TEST(Config, DeviceNamesAreChecked) {
  const auto problem = [](const std::string &trackers, const std::string &robots) {
    Config config;
    config.stages.of<NavigationParameters>().trackers = trackers;
    config.stages.of<SensorParameters>().robots = robots;
    const auto checked = check(config);
    return checked ? std::string() : checked.error().message;
  };
  EXPECT_EQ(problem("Tracker", ""), "");
  EXPECT_EQ(problem(" ", "Robot"), "");
  EXPECT_EQ(problem(" ", " "), "devices.trackers = \"\": at least one tracker or one robot is needed");
  EXPECT_EQ(problem("A,,B", ""), "devices.trackers = \"A,,B\": has an empty name between commas");
  EXPECT_EQ(problem("A", "B, A"), "devices.robots = \"B, A\": \"A\" is named twice");
  const std::string longest(31, 'x');
  EXPECT_EQ(problem(longest, ""), "");
  EXPECT_EQ(problem(longest + "y", ""), "devices.trackers = \"" + longest + "y\": \"" + longest +
                                            "y\" is longer than 31 bytes, which the wire would have to cut");
  std::string many = "D1";
  for (int i = 2; i <= bregma_wire_MAX_DEVICES - 1; ++i) {
    many += ",D" + std::to_string(i);
  }
  EXPECT_EQ(problem(many, ""), "devices: 35 are named, at most 32 can be shown")
      << "beside a force and a range sensor, a scanner and its coils";
}

TEST(Config, NamesAreSplitAtCommas) {
  EXPECT_TRUE(inputs::split_names("").empty());
  EXPECT_TRUE(inputs::split_names(" \t").empty());
  EXPECT_EQ(inputs::split_names(" A ,\tB C"), (std::vector<std::string>{"A", "B C"}));
  EXPECT_EQ(inputs::split_names("A,"), (std::vector<std::string>{"A", ""}));
}

TEST(Config, TheStateDirectoryFallsBackInOrder) {
  ::setenv("HOME", "/home/nurse", 1);
  ::unsetenv("STATE_DIRECTORY");
  ::unsetenv("XDG_STATE_HOME");
  EXPECT_EQ(runtime::state_directory(""), "/home/nurse/.local/state/bregma");
  ::setenv("XDG_STATE_HOME", "/xdg", 1);
  EXPECT_EQ(runtime::state_directory(""), "/xdg/bregma");
  ::setenv("STATE_DIRECTORY", "/var/lib/bregma:/var/lib/other", 1);
  EXPECT_EQ(runtime::state_directory(""), "/var/lib/bregma");
  EXPECT_EQ(runtime::state_directory("/tmp/here"), "/tmp/here");
}

} // namespace
} // namespace bregma::server
