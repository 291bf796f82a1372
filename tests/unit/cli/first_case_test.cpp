// docs/first-case.md: its commands on files, as they are printed, on a DICOM series of a round head that is made here.
#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <string>

#include <gtest/gtest.h>

#include "casefile/case.hpp"
#include "casefile/markups.hpp"
#include "tests/unit/cli/page_commands.hpp"
#include "tests/unit/cli/run_bregma.hpp"
#include "tests/unit/volumes/dicom_slices.hpp"
#include "tests/unit/volumes/files.hpp"

namespace {

using namespace bregma::casefile;
using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;
using Eigen::Vector3d;

constexpr int kSide = 36;
constexpr double kSpacing_mm = 6.0;
constexpr double kHead_mm = 90.0; // radius; 3.1 l

Vector3d place(int i, int j, int k) { return kSpacing_mm * Vector3d(i, j, k) - Vector3d::Constant(105.0); } // RAS

int intensity(const Vector3d &at, double radius_mm) {
  return at.norm() < radius_mm - 3.0 ? 100 : at.norm() < radius_mm + 3.0 ? 50 : 0;
}

bregma::image::Image<float, 3> head() {
  bregma::image::Image<float, 3> out;
  out.size = {kSide, kSide, kSide};
  out.T_image_index.topLeftCorner<3, 3>() *= kSpacing_mm;
  out.T_image_index.topRightCorner<3, 1>() = place(0, 0, 0);
  for (std::size_t i = 0; i < out.pixels(); ++i) {
    out.voxels.push_back(static_cast<float>(intensity(out.pixel_mm(i), kHead_mm)));
  }
  return out;
}

// In the same grid. The format of an image is known by its content, not by its name.
template <class Value> std::string nrrd(const Value &value) {
  std::ostringstream out;
  out << "NRRD0004\ntype: short\ndimension: 3\nspace: right-anterior-superior\nsizes: 36 36 36\n"
         "space directions: (6,0,0) (0,6,0) (0,0,6)\nspace origin: (-105,-105,-105)\nencoding: ascii\n\n";
  for (int k = 0; k < kSide; ++k) {
    for (int j = 0; j < kSide; ++j) {
      for (int i = 0; i < kSide; ++i) {
        out << value(place(i, j, k)) << '\n';
      }
    }
  }
  return out.str();
}

// What the page asks the reader to have.
void provide_files(const TemporaryFolder &folder) {
  bregma::test::write_dicom(folder / "dicom", head());
  folder.write("mask.nii.gz", nrrd([](const Vector3d &at) { return at.norm() < 65.0 ? 1 : 0; }));
  folder.write(
      "aal.nii.gz", nrrd([](const Vector3d &at) {
        return (at - Vector3d(-30, 0, 30)).norm() < 18.0 ? 1 : (at - Vector3d(30, 0, 30)).norm() < 18.0 ? 2 : 0;
      }));
  folder.write("aal.nii.txt", "1 Precentral_L 2001\n2 Precentral_R 2002\n");
  std::filesystem::copy_file(BREGMA_SOURCE_DIR "/demo/colin27/tools.toml", folder / "tools.toml");
  const double s = kHead_mm;
  const double d = s * std::sqrt(0.5);
  const NamedPoint fiducials[] = {{"F1", {s, 0, 0}}, {"F2", {-s, 0, 0}}, {"F3", {0, s, 0}},
                                  {"F4", {0, 0, s}}, {"F5", {0, -s, 0}}, {"F6", {d, 0, d}}};
  const NamedPoint landmarks[] = {{"L1", {d, d, 0}}, {"L2", {-d, d, 0}}, {"L3", {0, d, d}}};
  const NamedPoint targets[] = {{"T", {20, 10, 5}}};
  const Trajectory path[] = {{"Frontal right", {0, d, d}, {20, 10, 5}}};
  ASSERT_TRUE(write_points(folder / "fiducials.mrk.json", "f", fiducials) &&
              write_points(folder / "landmarks.mrk.json", "l", landmarks) &&
              write_points(folder / "targets.mrk.json", "t", targets) &&
              write_trajectories(folder / "trajectories.mrk.json", path));
}

TEST(FirstCase, TheCommandsOfThePageMakeACaseThatIsFitForUse) {
  const TemporaryFolder folder;
  provide_files(folder);
  int made = 0;
  int shown = 0;
  for (const std::string &command : bregma::tests::commands_of_page("first-case.md")) {
    const bool of_daemon = command.starts_with("case load") || command.find("case close") != std::string::npos;
    if (!command.starts_with("case ") || of_daemon) {
      continue;
    }
    SCOPED_TRACE(command);
    const auto run = run_bregma(folder, command);
    if (command == "case create first --image dicom/") {
      EXPECT_EQ(run.exit_code, 2);
      EXPECT_NE(run.err.find("a case also needs --fiducials"), std::string::npos) << run.err;
      continue;
    }
    ASSERT_EQ(run.exit_code, 0) << run.err << run.out;
    if (!command.starts_with("case create") || command.find("--force") != std::string::npos) {
      const auto lost = run_bregma(folder, command, bregma::tests::kFullDisk);
      EXPECT_EQ(lost.exit_code, 2);
      EXPECT_TRUE(lost.err.ends_with(bregma::tests::kOutputLost)) << lost.err;
    }
    if (command.starts_with("case create")) {
      ++made;
      const auto checked = run_bregma(folder, "case check first");
      EXPECT_EQ(checked.exit_code, 0) << checked.out;
      EXPECT_NE(checked.out.find("first: nothing wrong was found"), std::string::npos) << checked.out;
      const auto loaded = load_case(folder / "first");
      ASSERT_TRUE(loaded) << loaded.error().message;
      EXPECT_EQ(loaded->brain.mesh.triangles.empty(), made == 1);
      EXPECT_EQ(loaded->structures.size(), made == 1 ? 0U : 2U);
    }
    ++shown;
  }
  EXPECT_EQ(made, 2) << "without and with a brain";
  EXPECT_GE(shown, 5);
  EXPECT_TRUE(std::filesystem::exists(folder / "first.png"));
}

} // namespace
