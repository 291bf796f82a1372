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
#include "tests/unit/volumes/dicom_bytes.hpp"
#include "tests/unit/volumes/files.hpp"

namespace {

using namespace bregma::casefile;
using bregma::test::little;
using bregma::test::long_element;
using bregma::test::short_element;
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

std::string uid(std::uint32_t group, std::uint32_t element, std::string value) {
  value.append(value.size() % 2, '\0');
  return short_element(group, element, "UI", value);
}
std::string text(std::uint32_t group, std::uint32_t element, const char *type, std::string value) {
  value.append(value.size() % 2, ' ');
  return short_element(group, element, type, value);
}

std::string slice(int k) {
  const std::string storage = "1.2.840.10008.5.1.4.1.1.4";
  const std::string instance = "1.2.3.4." + std::to_string(k + 1);
  const auto count = [](std::uint32_t element, std::uint32_t value) {
    return short_element(0x0028, element, "US", little(value, 2));
  };
  std::string pixels;
  for (int j = 0; j < kSide; ++j) {
    for (int i = 0; i < kSide; ++i) {
      pixels += little(static_cast<std::uint32_t>(intensity(place(i, j, k), kHead_mm)), 2);
    }
  }
  const std::string meta = uid(2, 2, storage) + uid(2, 3, instance) + uid(2, 0x10, "1.2.840.10008.1.2.1");
  return std::string(128, '\0') + "DICM" +
         short_element(2, 0, "UL", little(static_cast<std::uint32_t>(meta.size()), 4)) + meta +
         uid(0x0008, 0x0016, storage) + uid(0x0008, 0x0018, instance) + text(0x0008, 0x0060, "CS", "MR") +
         text(0x0010, 0x0010, "PN", "Doe^Jane") + uid(0x0020, 0x000D, "1.2.3.5") + uid(0x0020, 0x000E, "1.2.3.6") +
         text(0x0020, 0x0013, "IS", std::to_string(k + 1)) +
         text(0x0020, 0x0032, "DS", "105\\105\\" + std::to_string(6 * k - 105)) +
         text(0x0020, 0x0037, "DS", "-1\\0\\0\\0\\-1\\0") + count(0x0002, 1) +
         text(0x0028, 0x0004, "CS", "MONOCHROME2") + count(0x0010, kSide) + count(0x0011, kSide) +
         text(0x0028, 0x0030, "DS", "6\\6") + count(0x0100, 16) + count(0x0101, 16) + count(0x0102, 15) +
         count(0x0103, 0) + long_element(0x7FE0, 0x0010, "OW", static_cast<std::uint32_t>(pixels.size()), pixels);
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
  std::filesystem::create_directory(folder / "dicom");
  for (int k = 0; k < kSide; ++k) {
    bregma::test::write_bytes(folder / ("dicom/IM" + std::to_string(k)), slice(k));
  }
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
