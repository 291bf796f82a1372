#include <gtest/gtest.h>

#include "base/parameters.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma::base;

enum class Mode { kSlow, kFast };

struct Config {
  double rate_hz = 30.0;
  double tiny = 0.1;
  std::int64_t depth = 8;
  bool strict = true;
  std::string folder = "sessions";
  std::string level = "info";
  Mode mode = Mode::kFast;
};

ParameterSet declare(Config &config) {
  ParameterSet set("bregmad");
  set.number("navigation.floor_rate_hz", &config.rate_hz, "Hz", 1, 1000, "State is published at least so often")
      .integer("recorder.depth", &config.depth, "", 1, 64, "How many.")
      .number("navigation.tiny", &config.tiny, "mm", 0, 1, "A small one.")
      .flag("recorder.strict", &config.strict, "Whether.")
      .string("folder", &config.folder, "Where sessions go")
      .choice("log.level", &config.level, {"debug", "info"}, "How much is said.")
      .choice("log.mode", &config.mode, {{"slow", Mode::kSlow}, {"fast", Mode::kFast}}, "How.");
  return set;
}

std::string parameters_error(const std::string &toml) {
  Config config;
  ParameterSet set = declare(config);
  const auto loaded = set.load_text(toml, "bregmad.toml");
  return loaded ? "no error" : loaded.error().message;
}

TEST(Parameters, AFileSetsItsValuesAndKeepsTheOthers) {
  Config config;
  ParameterSet set = declare(config);
  ASSERT_TRUE(set.load_text("folder = \"x\"\n[navigation]\nfloor_rate_hz = 60\n[log]\nmode = \"slow\"\n", "f"));
  EXPECT_EQ(config.rate_hz, 60.0);
  EXPECT_EQ(config.folder, "x");
  EXPECT_EQ(config.mode, Mode::kSlow);
  EXPECT_EQ(config.depth, 8);
}

TEST(Parameters, ErrorsNameFileLineKeyValueAndTheAllowedRange) {
  EXPECT_EQ(parameters_error("[navigation]\n\nfloor_rate_hz = 5000\n"),
            "bregmad.toml:3: navigation.floor_rate_hz = 5000: must be between 1 and 1000 Hz");
  EXPECT_EQ(parameters_error("[navigation]\nfloor_rate_hz = \"fast\"\n"),
            "bregmad.toml:2: navigation.floor_rate_hz = \"fast\": must be a number, in Hz");
  EXPECT_EQ(parameters_error("[navigation]\nfloor_rate_hz = nan\n"),
            "bregmad.toml:2: navigation.floor_rate_hz = nan: must be a finite number");
  EXPECT_EQ(parameters_error("[recorder]\ndepth = 2.5\n"),
            "bregmad.toml:2: recorder.depth = 2.5: must be a whole number");
  EXPECT_EQ(parameters_error("[recorder]\nstrict = 1\n"), "bregmad.toml:2: recorder.strict = 1: must be true or false");
  EXPECT_EQ(parameters_error("folder = 3\n"), "bregmad.toml:1: folder = 3: must be a text in quotes");
  EXPECT_EQ(parameters_error("[log]\nlevel = \"loud\"\n"),
            "bregmad.toml:2: log.level = \"loud\": must be one of \"debug\", \"info\"");
}

TEST(Parameters, UnknownKeysAreErrorsThatNameTheNearestKey) {
  EXPECT_EQ(parameters_error("[navigation]\nflor_rate_hz = 30\n"),
            "bregmad.toml:2: navigation.flor_rate_hz = 30: unknown key; did you mean navigation.floor_rate_hz?");
  EXPECT_EQ(parameters_error("[zzz]\nqqqqqqqqqq = 1\n"), "bregmad.toml:2: zzz.qqqqqqqqqq = 1: unknown key");
  EXPECT_EQ(parameters_error("[naviation]\n"), "bregmad.toml:1: naviation: unknown section");
  // The first error in the order of the file is reported.
  EXPECT_EQ(parameters_error("[recorder]\ndepth = 0\n[log]\nlevel = \"loud\"\n"),
            "bregmad.toml:2: recorder.depth = 0: must be between 1 and 64");
}

TEST(Parameters, SyntaxErrorsNameTheLine) {
  EXPECT_EQ(parameters_error("folder = \"x\"\n[log\n").rfind("bregmad.toml:2: ", 0), 0U)
      << parameters_error("folder = \"x\"\n[log\n");
}

TEST(Parameters, AFailedLoadHasNoEffect) {
  Config config;
  ParameterSet set = declare(config);
  ASSERT_FALSE(set.load_text("folder = \"changed\"\n[recorder]\ndepth = 0\n", "f"));
  EXPECT_EQ(config.folder, "sessions");
}

TEST(Parameters, AMissingFileIsNamed) {
  Config config;
  ParameterSet set = declare(config);
  const auto loaded = set.load("/no/such/file.toml");
  ASSERT_FALSE(loaded);
  EXPECT_EQ(loaded.error().message, "/no/such/file.toml: No such file or directory");
  EXPECT_EQ(set.load("/tmp").error().message, "/tmp: is a folder, not a file");
}

TEST(Parameters, TheWrittenFileIsReadBackBitForBit) {
  Config config;
  config.tiny = 0.1 + 0.2;
  config.folder = "a \"b\"\n\\c";
  config.mode = Mode::kSlow;
  const std::string written = declare(config).to_toml();
  Config read;
  ParameterSet set = declare(read);
  const auto loaded = set.load_text(written, "written");
  ASSERT_TRUE(loaded) << loaded.error().message << "\n" << written;
  EXPECT_EQ(read.tiny, config.tiny);
  EXPECT_EQ(read.folder, config.folder);
  EXPECT_EQ(read.mode, Mode::kSlow);
}

TEST(Parameters, TheWrittenFileIsCommentedAndKeepsSectionsTogether) {
  Config config;
  config.rate_hz = 50.0;
  Config defaults;
  ParameterSet set = declare(defaults);
  const std::string written = set.to_toml();
  EXPECT_NE(written.find("# State is published at least so often.\n# 1 to 1000 Hz; default 30.0\nfloor_rate_hz = 30.0"),
            std::string::npos)
      << written;
  EXPECT_LT(written.find("folder ="), written.find("[navigation]")) << "keys without a section come first";
  EXPECT_EQ(written.find("[recorder]"), written.rfind("[recorder]"));
  EXPECT_NE(set.to_markdown().find("| `navigation.floor_rate_hz` | `30.0` | 1 to 1000 Hz | State is"),
            std::string::npos)
      << set.to_markdown();
}

TEST(Parameters, AssignmentsOfACommandLine) {
  Config config;
  ParameterSet set = declare(config);
  ASSERT_TRUE(set.set_from_string("navigation.floor_rate_hz=100"));
  ASSERT_TRUE(set.set_from_string("folder = /var/lib/x y"));
  ASSERT_TRUE(set.set_from_string("log.mode=slow"));
  ASSERT_TRUE(set.set_from_string("recorder.strict=false"));
  EXPECT_EQ(config.rate_hz, 100.0);
  EXPECT_EQ(config.folder, "/var/lib/x y");
  EXPECT_EQ(config.mode, Mode::kSlow);
  EXPECT_FALSE(config.strict);
  const auto message = [&set](const char *text) { return set.set_from_string(text).error().message; };
  EXPECT_EQ(message("navigation.floor_rate_hz=0"), "navigation.floor_rate_hz = 0: must be between 1 and 1000 Hz");
  EXPECT_EQ(message("recorder.dept=3"), "recorder.dept = 3: unknown key; did you mean recorder.depth?");
  EXPECT_EQ(message("recorder.depth"), "\"recorder.depth\": must be key=value");
  EXPECT_EQ(message("recorder.depth=a b"), "recorder.depth = a b: is not a value");
  EXPECT_EQ(message("recorder.depth=3\nlog.level=1"), "recorder.depth = 3\nlog.level=1: is not a value");
}

TEST(Parameters, DeclarationsThatContradictThemselvesAreProgrammingErrors) {
  double value = 5.0;
  ParameterSet set("x");
  set.number("a.b", &value, "mm", 0, 10, "");
  EXPECT_THROW(set.number("a.b", &value, "mm", 0, 10, ""), std::logic_error);
  EXPECT_THROW(set.number("a.c", &value, "mm", 6, 10, ""), std::logic_error);
}

} // namespace
