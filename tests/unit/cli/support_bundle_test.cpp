// What goes into a support bundle, and that no identity does.
#include "clients/cli/support_bundle.hpp"

#include <cstdlib>
#include <string>

#include <unistd.h>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "idl/names.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma;
using namespace bregma::cli;

TEST(SupportBundle, TheConfigurationKeepsNumbersFlagsAndChoices) {
  EXPECT_EQ(anonymous_configuration(
                "# of Dr. Meier's room\ndomain_id = 7\n\n[state]\ndirectory = \"/home/jane/state\" # hers\n"
                "[log]\nlevel = \"debug\"\nfile = ''\n[recorder]\nenabled = false # by Jane\n"
                "[devices]\ntrackers = \"MeiersCamera\"\n[tracker]\nnear_mm = 9.5e2\n"),
            "domain_id = 7\n[state]\ndirectory = \"<text of 25 characters>\"\n[log]\nlevel = \"debug\"\n"
            "file = \"<text of 2 characters>\"\n[recorder]\nenabled = false\n[devices]\n"
            "trackers = \"<text of 14 characters>\"\n[tracker]\nnear_mm = 9.5e2\n");
}

TEST(SupportBundle, TheLogKeepsOurOwnWords) {
  const std::string time = "2026-11-29T09:22:28.123456Z ";
  const auto line = [&](const std::string &text) {
    const std::string out = anonymous_log(time + "info " + text + "\n");
    EXPECT_TRUE(out.starts_with(time + "info ") && out.ends_with("\n")) << out;
    return out.substr(time.size() + 5, out.size() - time.size() - 6);
  };
  EXPECT_EQ(line("bregmad 0.9 (abc) serves DDS domain 7"), "bregmad 0.9 (abc) serves DDS domain 7");
  EXPECT_EQ(line("bregma of jane 14 CAPTURE_FIDUCIAL: refused: fiducial \"Nasion\" is not in case doe_jane"),
            "command CAPTURE_FIDUCIAL: refused");
  EXPECT_EQ(line("jane 1 LOAD_CASE: case doe_jane is loaded"), "command LOAD_CASE: done");
  EXPECT_EQ(line("alarm raised: tool_hidden Meiers Probe: is not seen"), "alarm raised: tool_hidden");
  EXPECT_EQ(line("restored case doe_jane as Registered with 8 fiducials"), "restored case  <text of 39 characters>");
  EXPECT_EQ(line("the last session is not restored: /home/jane/doe: No such file"),
            "the last session is not restored <text of 30 characters>");
  EXPECT_EQ(line("memory: see /home/jane/limits.conf"), "memory: see <path>");
  EXPECT_EQ(line("the navigation loop does not advance"), "the navigation loop does not advance");
  EXPECT_EQ(line("Jane Doe was here"), "<text of 17 characters>");
  EXPECT_EQ(anonymous_log("Jane Doe without a time\n"), "<text of 23 characters>\n");
  EXPECT_EQ(anonymous_log(time + "info " + std::string(1'000'000, 'x') + "\n"), "<text of 1000033 characters>\n");
}

TEST(SupportBundle, TheHealthHasDevicesAndAlarmsByTheirKind) {
  wire::SystemHealth health{};
  wire::set_text(health.case_folder, "/cases/doe_jane");
  health.session = bregma_wire_SESSION_NAVIGATING;
  health.device_count = 1;
  ASSERT_TRUE(wire::set_name(health.devices[0].device, "MeiersCamera") && wire::set_name(health.host, "or3-jane"));
  health.devices[0].kind = bregma_wire_DEVICE_TRACKER;
  health.devices[0].lost = 17;
  health.loop_count = 1;
  ASSERT_TRUE(wire::set_name(health.loops[0].loop, "navigation"));
  wire::Alarm alarm{};
  ASSERT_TRUE(wire::set_name(alarm.kind, "tool_hidden") && wire::set_name(alarm.subject, "JanesProbe"));
  wire::set_text(alarm.text, "JanesProbe is not seen");
  alarm.count = 3;
  const nlohmann::json json = anonymous_health(health, {alarm});
  EXPECT_EQ(json["case_is_loaded"], true);
  EXPECT_EQ(json["session"], "navigating");
  EXPECT_EQ(json["devices"][0]["kind"], "tracker");
  EXPECT_EQ(json["devices"][0]["lost"], 17);
  EXPECT_EQ(json["loops"][0]["loop"], "navigation");
  EXPECT_EQ(json["alarms"][0]["kind"], "tool_hidden");
  EXPECT_EQ(json["alarms"][0]["count"], 3);
  const std::string text = json.dump();
  for (const char *name : {"jane", "Jane", "Meiers", "or3", "/cases"}) {
    EXPECT_EQ(text.find(name), std::string::npos) << name << "\n" << text;
  }
  health.device_count = health.loop_count = 4'000'000'000U; // from the wire
  EXPECT_EQ(anonymous_health(health, {})["devices"].size(), bregma_wire_MAX_DEVICES);
}

TEST(SupportBundle, TheArchiveIsReadByTar) {
  const test::TemporaryFolder folder;
  const auto file = folder / "fault.tar.gz";
  const std::string large(300'000, 'a');
  const BundlePart parts[] = {{"a.txt", "one\n"}, {"empty.txt", ""}, {"large.txt", large}};
  const auto written = write_bundle(file, parts);
  ASSERT_TRUE(written) << written.error().message;
  const std::string unpack = "cd '" + folder.path().string() + "' && tar -xzf fault.tar.gz";
  ASSERT_EQ(std::system(unpack.c_str()), 0); // NOLINT(bugprone-command-processor,cert-env33-c): a test's own words
  EXPECT_EQ(tests::read_file(folder / "a.txt"), "one\n");
  EXPECT_EQ(tests::read_file(folder / "empty.txt"), "");
  EXPECT_EQ(tests::read_file(folder / "large.txt"), large);

  const auto again = write_bundle(file, parts);
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().message, file.string() + ": exists already");
  const auto nowhere = write_bundle(folder / "no/such/place.tar.gz", parts);
  ASSERT_FALSE(nowhere);
  EXPECT_NE(nowhere.error().message.find("cannot be written"), std::string::npos) << nowhere.error().message;
}

TEST(SupportBundle, AFullDiskLeavesNoFile) {
  const BundlePart parts[] = {{"a.txt", std::string(100'000, 'a')}};
  const test::TemporaryFolder folder;
  std::filesystem::create_symlink("/dev/full", folder / "b.tar.gz.part");
  const auto full = write_bundle(folder / "b.tar.gz", parts);
  ASSERT_FALSE(full);
  EXPECT_NE(full.error().message.find("the disk is full"), std::string::npos) << full.error().message;
  EXPECT_FALSE(std::filesystem::exists(folder / "b.tar.gz"));
}

TEST(SupportBundle, PathsAreNotIdentities) {
  EXPECT_EQ(without_paths("disk of /home/jane/.local: 3.2 MB/s, see \"/a b\" and (/c)"),
            "disk of <path>: 3.2 MB/s, see \"<path> b\" and (<path>)");
  EXPECT_EQ(without_paths("/x"), "<path>");
}

TEST(SupportBundle, TheMachineIsNotNamed) {
  const std::string text = machine_text();
  EXPECT_NE(text.find("kernel        Linux"), std::string::npos) << text;
  char host[256] = {};
  ASSERT_EQ(gethostname(host, sizeof host - 1), 0);
  EXPECT_EQ(text.find(host), std::string::npos) << text;
}

} // namespace
