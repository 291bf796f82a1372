// Standard output that takes nothing, like a full disk: no command may say that all went well.
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "casefile/itk_transform.hpp"
#include "casefile/mesh_file.hpp"
#include "tests/unit/casefile/sample_case.hpp"
#include "tests/unit/cli/calibration_files.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::expect_lost_output_is_said;
using bregma::tests::kFullDisk;
using bregma::tests::kOutputLost;
using bregma::tests::read_file;
using bregma::tests::run_bregma;

// The command table, as the program's completion lists it: "case", "case create", ...
std::vector<std::string> commands() {
  const TemporaryFolder folder;
  const std::string script = run_bregma(folder, "completion bash").out;
  std::vector<std::string> out;
  const std::regex row("\n    '(/[^']*)'\\) words=");
  for (std::sregex_iterator at(script.begin(), script.end(), row), end; at != end; ++at) {
    std::string path = (*at)[1].str().substr(1);
    std::replace(path.begin(), path.end(), '/', ' ');
    out.push_back(path);
  }
  return out;
}

TEST(FullOutput, EveryCommandSaysThatItsHelpWasLost) {
  const TemporaryFolder folder;
  const auto all = commands();
  ASSERT_GT(all.size(), 40U);
  for (const std::string &command : all) {
    const auto run = run_bregma(folder, command + " --help", kFullDisk);
    EXPECT_EQ(run.exit_code, 2) << command;
    EXPECT_EQ(run.err, kOutputLost) << command;
  }
  EXPECT_EQ(run_bregma(folder, "--help", kFullDisk).exit_code, 2);
  EXPECT_EQ(run_bregma(folder, "--version", kFullDisk).exit_code, 2);
}

// Commands that need no daemon. What they write to files is whole. Those of images, of scanners, of the tissue and of
// sessions are with their own tests (ctest -R FullOutput).
TEST(FullOutput, AResultThatWasLostIsNoSuccess) {
  const TemporaryFolder folder;
  folder.write("ball/image.nii.gz", "not read here");
  ASSERT_TRUE(bregma::casefile::save_case(bregma::tests::sample_case(folder.path() / "ball")));
  folder.write("a.csv", "name,x,y,z\nA,0,0,0\nB,100,0,0\nC,0,80,0\nD,0,0,60\nE,70,60,50\n");
  folder.write("b.csv", "name,x,y,z\nA,5,0,0\nB,105,0,0\nC,5,80,0\nD,5,0,60\nE,75,60,50\n");
  for (const char *command : {"case show ball", "case check ball", "case picture ball ball.png --size 64",
                              "case export ball scalp.stl --surface scalp --force",
                              "case mesh ball --elements 10000 --out ball.vtu", "register points a.csv b.csv",
                              "register points a.csv b.csv --tfm a_to_b.tfm", "image list ball", "tissue materials"}) {
    expect_lost_output_is_said(folder, command);
  }
  EXPECT_FALSE(read_file(folder / "a_to_b.tfm").empty());
  for (const char *command : {"completion bash", "completion zsh"}) {
    const auto run = run_bregma(folder, command, kFullDisk);
    EXPECT_EQ(run.exit_code, 2) << command;
    EXPECT_EQ(run.err, kOutputLost);
  }
}

std::string rows_of(const std::vector<Eigen::Vector3d> &points, const std::string &before = {}) {
  std::ostringstream out;
  for (const auto &p : points) {
    out << before << p.x() << ',' << p.y() << ',' << p.z() << '\n';
  }
  return out.str();
}

TEST(FullOutput, ALostRegistrationIsNoSuccess) {
  const TemporaryFolder folder;
  // An egg, on which samples can neither slide nor turn.
  auto egg = bregma::tests::sphere({0, 0, 0}, 1, 4);
  for (auto &v : egg.vertices_mm) {
    v = v.cwiseProduct(Eigen::Vector3d(70, 95, v.z() > 0 ? 85 : 110)) + Eigen::Vector3d(0.0, 0.0, 12.0 * v.x());
  }
  ASSERT_TRUE(bregma::casefile::write_mesh(folder / "egg.ply", egg));
  std::vector<Eigen::Vector3d> samples;
  for (std::size_t i = 0; i < egg.vertices_mm.size(); i += 5) {
    samples.push_back(egg.vertices_mm[i]);
  }
  folder.write("trace.csv", rows_of(samples));
  ASSERT_TRUE(bregma::casefile::write_itk_transform(folder / "start.tfm", Eigen::Matrix4d::Identity()));
  samples.resize(40);
  folder.write("few.csv", rows_of(samples));
  folder.write("curves.csv", "curve,x,y,z\n" + rows_of({{0, 0, 0}, {30, 10, 5}, {60, 0, 0}}, "a,") +
                                 rows_of({{0, 40, 0}, {30, 50, 20}, {60, 40, 30}}, "b,"));
  for (const char *command :
       {"register surface trace.csv egg.ply --start start.tfm", "register surface trace.csv egg.ply",
        "register cloud few.csv few.csv", "register curves curves.csv curves.csv"}) {
    expect_lost_output_is_said(folder, command);
  }
}

TEST(FullOutput, ALostCalibrationIsNoSuccess) {
  const TemporaryFolder folder;
  bregma::tests::write_poses(folder, 100, 0.4);
  bregma::tests::write_hand_eye(folder, Eigen::Vector3d::Ones());
  bregma::tests::write_plane_scan(folder, 0.35);
  bregma::tests::write_readings(folder);
  for (const char *command : {"calibrate pivot poses", "calibrate hand-eye flange body",
                              "calibrate beam plane.csv --range-mm 0.1", "calibrate range readings.csv"}) {
    EXPECT_EQ(run_bregma(folder, command).exit_code, 0) << command;
    expect_lost_output_is_said(folder, command);
  }
}

TEST(FullOutput, ALostDiagnosisIsNoSuccess) {
  const TemporaryFolder folder;
  expect_lost_output_is_said(folder, "doctor --quick");
}

// Every program that is installed, and the simulators.
TEST(FullOutput, EveryProgramSaysThatItsHelpWasLost) {
  std::istringstream programs(BREGMA_PROGRAMS);
  int asked = 0;
  for (std::string program; std::getline(programs, program, ':'); ++asked) {
    const TemporaryFolder folder;
    const std::string name = std::filesystem::path(program).filename();
    const auto ask = [&](const std::string &to) {
      const std::string command =
          "'" + program + "' --help >'" + to + "' 2>'" + (folder / "err").string() + "' </dev/null";
      const int status = std::system(command.c_str()); // NOLINT(bugprone-command-processor,cert-env33-c)
      return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    };
    EXPECT_EQ(ask((folder / "out").string()), 0) << name;
    EXPECT_EQ(ask(kFullDisk), 2) << name;
    EXPECT_EQ(read_file(folder / "err"), name + ": the output could not be written completely\n");
  }
  EXPECT_EQ(asked, 14);
}

} // namespace
