// `bregma arm` as a program: motions that are checked first.
#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::kFullDisk;
using bregma::tests::kOutputLost;
using bregma::tests::read_file;
using bregma::tests::run_bregma;

const std::string kArm = " --arm '" BREGMA_SOURCE_DIR "/robots/mz07f.toml'";
const std::string kScan = "arm scan" + kArm + " --x 380 520 --y -20 20 --line-mm 10";

// A closed block in FreeSurfer's text format.
std::string block_text(double x0, double x1, double y0, double y1, double z0, double z1) {
  std::string out = "#!ascii\n8 12\n";
  for (int i = 0; i < 8; ++i) {
    out += std::to_string((i & 1) != 0 ? x1 : x0) + " " + std::to_string((i & 2) != 0 ? y1 : y0) + " " +
           std::to_string((i & 4) != 0 ? z1 : z0) + " 0\n";
  }
  return out + "0 2 3 0\n0 3 1 0\n4 5 7 0\n4 7 6 0\n0 1 5 0\n0 5 4 0\n2 6 7 0\n2 7 3 0\n0 4 6 0\n0 6 2 0\n1 3 7 0\n"
               "1 7 5 0\n";
}

TEST(ArmCommand, WritesTheProgramOfAScanThatIsClear) {
  const TemporaryFolder folder;
  folder.write("low.asc", block_text(400, 500, -60, 60, 0, 90));
  const auto run = run_bregma(folder, kScan + " --head low.asc --head-space ras --gcode scan.nc --json");
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out;
  const auto json = run.json();
  EXPECT_EQ(json["verdict"], "clear");
  EXPECT_EQ(json["lines"], 5);
  EXPECT_DOUBLE_EQ(json["scan_mm"].get<double>(), 5 * 140.0 + 4 * 10.0);
  EXPECT_DOUBLE_EQ(json["seconds"].get<double>(), 740.0 / 5.0);
  EXPECT_EQ(json["nearest"]["part"], "sensor");
  EXPECT_NEAR(json["nearest"]["distance_mm"].get<double>(), 200.0 - 90.0 - 25.0, 0.1);
  const std::string program = read_file(folder / "scan.nc");
  EXPECT_NE(program.find("G1 X520.000 Y-20.000 Z200.000 F300.0\n"), std::string::npos) << program;
}

TEST(ArmCommand, RefusesAScanThatMeetsTheHeadAndWritesNothing) {
  const TemporaryFolder folder;
  folder.write("high.asc", block_text(400, 500, -60, 60, 0, 190));
  auto run = run_bregma(folder, kScan + " --head high.asc --head-space ras --gcode scan.nc");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.out.find("collision: sensor comes within 0.0 mm of head"), std::string::npos) << run.out;
  EXPECT_FALSE(std::filesystem::exists(folder / "scan.nc"));
  run = run_bregma(folder, "arm scan" + kArm + " --x 380 1500 --y -20 20 --gcode scan.nc --json");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.json()["verdict"], "not_reached");
  EXPECT_FALSE(std::filesystem::exists(folder / "scan.nc"));
}

TEST(ArmCommand, AMoveIsCheckedAlongItsLine) {
  const TemporaryFolder folder;
  const std::string move = "arm move" + kArm + " --start-deg 0 80 0 5 -60 0 --to-deg 40 80 0 5 -60 0 --json";
  const auto clear = run_bregma(folder, move);
  ASSERT_EQ(clear.exit_code, 0) << clear.err;
  EXPECT_NEAR(clear.json()["end_deg"][0].get<double>(), 40.0, 1e-6);
  EXPECT_LE(clear.json()["bound_mm"].get<double>(), clear.json()["nearest"]["distance_mm"].get<double>());
  // Both ends are clear of a post between them.
  folder.write("post.asc", block_text(400, 480, 100, 160, 0, 700));
  const auto run = run_bregma(folder, move + " --head post.asc --head-space ras");
  EXPECT_EQ(run.exit_code, 1) << run.out;
  EXPECT_EQ(run.json()["verdict"], "too_close");
  EXPECT_GT(run.json()["at_mm"].get<double>(), 1.0);
}

TEST(ArmCommand, MistakesAreOneSentence) {
  const TemporaryFolder folder;
  folder.write("open.asc", "#!ascii\n3 1\n0 0 0 0\n100 0 0 0\n0 100 0 0\n0 1 2 0\n");
  for (const auto &[arguments, words] : std::vector<std::pair<std::string, std::string>>{
           {"arm scan --arm gone.toml --x 1 2 --y 1 2", "gone.toml"},
           {"arm scan" + kArm + " --x 500 400 --y 0 1", "the area of the scan has no extent"},
           {"arm scan" + kArm + " --x 3000 3100 --y 0 1", "the arm does not reach the first position"},
           {kScan + " --start-deg 0 300 0 0 0 0", "--start-deg: joint 2 is beyond its limits"},
           {kScan + " --head open.asc --head-space ras", "obstacle head: its mesh is not closed"},
           {"arm move" + kArm + " --to-deg 0 80 0 5 -60 0", "--start-deg"}}) {
    SCOPED_TRACE(arguments);
    const auto run = run_bregma(folder, arguments);
    EXPECT_EQ(run.exit_code, 2);
    EXPECT_NE(run.err.find(words), std::string::npos) << run.err;
    EXPECT_EQ(run.out, "");
  }
  const auto lost = run_bregma(folder, kScan, kFullDisk);
  EXPECT_EQ(lost.exit_code, 2);
  EXPECT_TRUE(lost.err.ends_with(kOutputLost)) << lost.err;
}

} // namespace
