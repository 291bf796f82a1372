#include <gtest/gtest.h>

#include "base/table_reader.hpp"

namespace {

using namespace bregma::base;

TomlDocument parse(const std::string &text) {
  auto document = TomlDocument::parse(text, "scenario.toml");
  EXPECT_TRUE(document) << (document ? "" : document.error().message);
  return *document;
}

template <class Read> std::string table_error(const std::string &text, Read read) {
  const TomlDocument document = parse(text);
  TableReader root = document.root();
  read(root);
  const auto finished = root.finish();
  return finished ? "no error" : finished.error().message;
}

TEST(TableReader, ReadsAllKindsOfValues) {
  const TomlDocument document = parse("name = \"a\"\nrate = 60\ncount = 3\non = true\nat = [1, 2.5, -3]\n"
                                      "markers = [[0,0,0],[1,0,0]]\nwords = [\"x\", \"y\"]\nkind = \"b\"\n"
                                      "[limits]\nfre = 1.5\n[[steps]]\ndo = \"load\"\n[[steps]]\ndo = \"touch\"\n");
  TableReader root = document.root();
  EXPECT_EQ(root.require_string("name"), "a");
  EXPECT_EQ(root.number("rate", 1.0, "Hz", 0, 100), 60.0);
  EXPECT_EQ(root.require_integer("count", "", 0, 10), 3);
  EXPECT_TRUE(root.flag("on", false));
  EXPECT_EQ(root.require_vector3("at"), Eigen::Vector3d(1, 2.5, -3));
  EXPECT_EQ(root.vector3s("markers").size(), 2U);
  EXPECT_EQ(root.strings("words"), (std::vector<std::string>{"x", "y"}));
  EXPECT_EQ(root.choice("kind", "a", {"a", "b"}), "b");
  EXPECT_EQ(root.number("absent", 7.0, "mm", 0, 10), 7.0);
  auto limits = root.table("limits");
  ASSERT_TRUE(limits);
  EXPECT_EQ(limits->require_number("fre", "mm", 0, 10), 1.5);
  auto steps = root.tables("steps");
  ASSERT_EQ(steps.size(), 2U);
  EXPECT_EQ(steps[1].require_string("do"), "touch");
  EXPECT_TRUE(root.finish());
}

TEST(TableReader, WhatWasAskedForIsTheLayoutOfTheFile) {
  const TomlDocument document = parse("[[steps]]\n[[steps]]\n[limits]\n");
  TableReader root = document.root();
  root.string("name", "a");
  for (TableReader &step : root.tables("steps")) {
    step.require_vector3s("markers");
    step.vector3("axis", -Eigen::Vector3d::UnitX());
  }
  auto limits = root.table("limits");
  limits->number("fre", 1.5, "mm", 0.0, 10.0);
  EXPECT_EQ(limits->optional_number("tre", "mm", 0.5, 2.0), std::nullopt);
  limits->choice("kind", "a", {"a", "b"});
  const std::vector<KnownKey> expected{{"name", false, "text", "\"a\""},
                                       {"steps[].markers", true, "list of [x, y, z]", ""},
                                       {"steps[].axis", false, "[x, y, z]", "[-1.0, 0.0, 0.0]"},
                                       {"limits.fre", false, "0 to 10 mm", "1.5"},
                                       {"limits.tre", false, "0.5 to 2 mm", ""},
                                       {"limits.kind", false, "one of \"a\", \"b\"", "\"a\""}};
  EXPECT_EQ(document.known_keys(), expected);
}

TEST(TableReader, ErrorsOfNestedTablesNameTheWholePath) {
  EXPECT_EQ(table_error("[[steps]]\ndo = \"a\"\n\n[[steps]]\nseconds = -1\n",
                        [](TableReader &root) {
                          for (TableReader &step : root.tables("steps")) {
                            step.string("do", "");
                            step.number("seconds", 1.0, "s", 0, 60);
                          }
                        }),
            "scenario.toml:5: steps[1].seconds = -1: must be between 0 and 60 s");
}

TEST(TableReader, AMissingKeyIsNamedWithTheLineOfItsTable) {
  EXPECT_EQ(table_error("a = 1\n[limits]\n",
                        [](TableReader &root) {
                          root.integer("a", 0, "", 0, 9);
                          root.table("limits")->require_number("fre_mm", "mm", 0, 5);
                        }),
            "scenario.toml:2: limits.fre_mm: is missing");
}

TEST(TableReader, UnknownKeysAreRefusedAtEveryLevel) {
  EXPECT_EQ(table_error("rate = 1\nrat = 2\n", [](TableReader &root) { root.number("rate", 0, "Hz", 0, 9); }),
            "scenario.toml:2: rat = 2: unknown key; did you mean rate?");
  EXPECT_EQ(table_error("[limits]\nfremm = 2\n",
                        [](TableReader &root) {
                          auto limits = root.table("limits");
                          limits->number("fre_mm", 1, "mm", 0, 9);
                          EXPECT_FALSE(limits->finish());
                        }),
            "scenario.toml:2: limits.fremm = 2: unknown key; did you mean limits.fre_mm?");
  EXPECT_EQ(table_error("[extra]\na = 1\n", [](TableReader &) {}), "scenario.toml:1: extra: unknown key");
}

TEST(TableReader, WrongTypesAreRefused) {
  const auto vector = [](TableReader &root) { root.require_vector3("v"); };
  EXPECT_EQ(table_error("v = [1, 2]\n", vector),
            "scenario.toml:1: v = [ 1, 2 ]: must be three finite numbers, [x, y, z]");
  EXPECT_EQ(table_error("v = [1, 2, nan]\n", vector),
            "scenario.toml:1: v = [ 1, 2, nan ]: must be three finite numbers, [x, y, z]");
  EXPECT_EQ(table_error("m = [[0,0,0],\n [1,0]]\n", [](TableReader &root) { root.vector3s("m"); }),
            "scenario.toml:2: m[1] = [ 1, 0 ]: must be three finite numbers, [x, y, z]");
  EXPECT_EQ(table_error("s = [\"a\", 1]\n", [](TableReader &root) { root.strings("s"); }),
            "scenario.toml:1: s[1] = 1: must be a text in quotes");
  EXPECT_EQ(table_error("steps = 3\n", [](TableReader &root) { root.tables("steps"); }),
            "scenario.toml:1: steps = 3: must be a list of tables, [[steps]]");
  EXPECT_EQ(table_error("limits = 3\n", [](TableReader &root) { root.table("limits"); }),
            "scenario.toml:1: limits = 3: must be a section, [limits]");
}

TEST(TableReader, TheFirstErrorIsKeptAndReadingContinues) {
  EXPECT_EQ(table_error("a = 20\nb = 30\n",
                        [](TableReader &root) {
                          EXPECT_EQ(root.number("a", 1.0, "mm", 0, 10), 1.0);
                          EXPECT_EQ(root.require_number("b", "mm", 0, 10), 0.0);
                          root.refuse("b", "does not suit a");
                        }),
            "scenario.toml:1: a = 20: must be between 0 and 10 mm");
}

TEST(TableReader, ChecksOfTheCallerReportTheFileAndLine) {
  EXPECT_EQ(table_error("[[tools]]\nname = \"A\"\n[[tools]]\nname = \"A\"\n",
                        [](TableReader &root) {
                          for (TableReader &tool : root.tables("tools")) {
                            tool.require_string("name");
                          }
                          root.refuse("tools[1].name", "is taken");
                        }),
            "scenario.toml:4: tools[1].name = \"A\": is taken");
}

} // namespace
