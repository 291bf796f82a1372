// `bregma mri register` on files, and the files that it reads.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "casefile/coil_frames.hpp"
#include "casefile/volumes/scan_fields_file.hpp"
#include "casefile/volumes/volume.hpp"
#include "tests/unit/cli/run_bregma.hpp"
#include "tests/unit/scanner/drawn_stacks.hpp"

namespace bregma::mri::test {

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::Outcome;
using bregma::tests::run_bregma;

void write(const TemporaryFolder &folder, const char *name, const std::string &text) {
  std::ofstream(folder.path() / name) << text;
}

// As a file in RAS; drawn stacks are in Device, for a patient on the back, head first.
void save(const TemporaryFolder &folder, const char *name, Stack stack) {
  stack.T_image_index.row(0) *= -1.0;
  stack.T_image_index.row(2) *= -1.0;
  const auto done = casefile::write_volume(folder.path() / name, stack);
  ASSERT_TRUE(done.has_value()) << done.error().message;
}

const std::string kScans = "frame = \"frame.toml\"\n[[scans]]\nname = \"all\"\norientation = \"T\"\n"
                           "background = \"off.nrrd\"\nforeground = \"on.nrrd\"\non = [\"a\", \"b\"]\n";

// A frame, a background, and a foreground in which all coils carry current.
struct Files {
  Files() {
    write(folder, "frame.toml", casefile::coil_frame_text(frame));
    write(folder, "scans.toml", kScans);
    save(folder, "off.nrrd", drawn({}, 0, 1));
    save(folder, "on.nrrd", drawn(places(frame, {0, 1, 2, 3, 4, 5}, kPlaced), 6.0, 2));
  }
  Outcome run(const std::string &more = "") const { return run_bregma(folder, "mri register scans.toml " + more); }

  TemporaryFolder folder;
  CoilFrame frame = small_frame();
};

} // namespace

TEST(MriRegister, FindsTheFrameInFiles) {
  const Files files;
  const auto run = files.run("--distortion-mm 0.2 --json");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  const auto json = run.json();
  EXPECT_EQ(json["verdict"], "found");
  EXPECT_EQ(json["coils"].size(), 6U);
  const Eigen::Matrix4d expected = kPlaced.inverse().matrix();
  for (std::size_t r = 0; r < 3; ++r) {
    EXPECT_NEAR(json["T_base_device"][r][3].get<double>(), expected(static_cast<int>(r), 3), 0.4);
  }
  EXPECT_LT(json["predicted_error_95_mm"].get<double>(), 1.0);
  bregma::tests::expect_lost_output_is_said(files.folder, "mri register scans.toml --distortion-mm 0.2");
  const auto text = files.run("--distortion-mm 0.2");
  EXPECT_NE(text.out.find("Predicted error at the target"), std::string::npos) << text.out;
  EXPECT_NE(text.out.find("Consistency of the coils (FRE)"), std::string::npos) << text.out;
}

TEST(MriRegister, CoilsThatVerifyTakeNoPart) {
  const Files files;
  write(files.folder, "scans.toml", kScans + "verify = [\"b3\"]\n");
  const auto run = files.run("--distortion-mm 0.2 --json");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  const auto json = run.json();
  EXPECT_EQ(json["coils"].size(), 5U);
  ASSERT_EQ(json["verified"].size(), 1U);
  EXPECT_EQ(json["verified"][0]["coil"], "b3");
  EXPECT_LT(json["verified_rms_mm"].get<double>(), 0.6);
}

TEST(MriRegister, AFieldCorrectsTheCoilsAndStatesItsError) {
  const Files files;
  // A scanner that shows everything 3 mm too far to the right and stretches by 2 %, as a field on a grid in RAS.
  const auto shown = [](const Vector3d &ras) -> Vector3d { return 0.02 * ras + Vector3d(3, 0, 0); };
  casefile::DisplacementField field;
  for (auto *grid : {static_cast<image::Grid<3> *>(&field.displacement_mm),
                     static_cast<image::Grid<3> *>(&field.signed_error_95_mm)}) {
    grid->size = {9, 9, 9};
    grid->T_image_index.topLeftCorner<3, 3>() = 30.0 * Eigen::Matrix3d::Identity();
    grid->T_image_index.topRightCorner<3, 1>() = Vector3d::Constant(-120.0);
  }
  for (std::size_t i = 0; i < field.displacement_mm.pixels(); ++i) {
    field.displacement_mm.voxels.push_back(shown(field.displacement_mm.pixel_mm(i)).cast<float>());
  }
  field.signed_error_95_mm.voxels.assign(field.signed_error_95_mm.pixels(), 0.3F);
  field.max_error_95_mm = 2.0;
  field.made = "2026-01-01";
  ASSERT_TRUE(casefile::write_displacement_field(files.folder.path() / "field.nrrd", field));
  std::vector<Vector3d> balls;
  for (const Vector3d &p : places(files.frame, {0, 1, 2, 3, 4, 5}, kPlaced)) {
    const Vector3d moved = shown(Vector3d(-p.x(), p.y(), -p.z())); // Device to RAS
    balls.push_back(p + Vector3d(-moved.x(), moved.y(), -moved.z()));
  }
  save(files.folder, "on.nrrd", drawn(balls, 6.0, 2));

  const auto run = files.run("--field field.nrrd --not-corrected --json");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  const auto json = run.json();
  EXPECT_EQ(json["verdict"], "found") << json;
  const Eigen::Matrix4d expected = kPlaced.inverse().matrix();
  for (std::size_t r = 0; r < 3; ++r) {
    EXPECT_NEAR(json["T_base_device"][r][3].get<double>(), expected(static_cast<int>(r), 3), 0.4);
  }
  EXPECT_LT(json["fre_mm"].get<double>(), 0.4);
  const auto plain = files.run("--json").json();
  EXPECT_GT(plain["fre_mm"].get<double>(), json["fre_mm"].get<double>() + 0.3);
  EXPECT_GT(plain["predicted_error_95_mm"].get<double>(), json["predicted_error_95_mm"].get<double>());

  // Whether the vendor has corrected an NRRD is not known.
  const auto doubtful = files.run("--field field.nrrd");
  EXPECT_EQ(doubtful.exit_code, 2);
  EXPECT_NE(doubtful.err.find("--not-corrected"), std::string::npos) << doubtful.err;
}

// B0 shifts all coils alike, by 1.5 mm: no fit shows it, opposed read-outs do.
TEST(MriRegister, OpposedReadOutsAreFreeOfB0) {
  const Files files;
  const auto shifted = [&](double x_mm, std::uint64_t seed) {
    std::vector<Vector3d> shown = places(files.frame, {0, 1, 2, 3, 4, 5}, kPlaced);
    for (Vector3d &p : shown) {
      p.x() += x_mm; // Device's x is L
    }
    return drawn(shown, 6.0, seed);
  };
  save(files.folder, "on.nrrd", shifted(1.5, 2));
  save(files.folder, "off_opposed.nrrd", drawn({}, 0, 3));
  save(files.folder, "on_opposed.nrrd", shifted(-1.5, 4));
  image::Image<Eigen::Vector3f, 3> none;
  image::Image<float, 3> stated;
  for (auto *grid : {static_cast<image::Grid<3> *>(&none), static_cast<image::Grid<3> *>(&stated)}) {
    grid->size = {2, 2, 2};
    grid->T_image_index.diagonal().head<3>().setConstant(240.0);
    grid->T_image_index.topRightCorner<3, 1>().setConstant(-120.0);
  }
  none.voxels.assign(8, Eigen::Vector3f::Zero());
  stated.voxels.assign(8, 0.2F);
  const auto table = std::make_shared<const FieldTable>(none, stated, 2.0);
  casefile::FieldHeader header;
  header.made = "2026-01-01";
  ASSERT_TRUE(casefile::write_scan_fields(files.folder.path() / "both.nrrd",
                                          ScanFields(table, table, Vector3d::UnitX() / 260.0), header));
  ASSERT_TRUE(casefile::write_scan_fields(files.folder.path() / "one.nrrd",
                                          ScanFields(table, Vector3d::UnitX() / 260.0), header));
  const std::string read_out = "read_out = \"L\"\nbandwidth_Hz = 260\n" + kScans;
  const std::string opposed =
      read_out + "background_opposed = \"off_opposed.nrrd\"\nforeground_opposed = \"on_opposed.nrrd\"\n";

  write(files.folder, "scans.toml", read_out);
  const auto error_of = [&](const nlohmann::json &json) {
    return json["T_base_device"][0][3].get<double>() - kPlaced.inverse().matrix()(0, 3);
  };
  const auto one = files.run("--field both.nrrd --not-corrected --json");
  ASSERT_EQ(one.exit_code, 0) << one.out << one.err;
  EXPECT_NEAR(std::abs(error_of(one.json())), 1.5, 0.3);
  EXPECT_TRUE(one.json()["b0_change_mm"].is_null());
  write(files.folder, "scans.toml", opposed);
  const auto both = files.run("--field both.nrrd --not-corrected --json");
  ASSERT_EQ(both.exit_code, 0) << both.out << both.err;
  EXPECT_NEAR(error_of(both.json()), 0.0, 0.3);
  EXPECT_NEAR(both.json()["b0_change_mm"].get<double>(), 1.5, 0.2) << "none was mapped";
  const auto text = files.run("--field both.nrrd --not-corrected");
  EXPECT_NE(text.out.find("B0 has changed by up to 1."), std::string::npos) << text.out;

  const auto error = [&](const std::string &field) {
    const auto run = files.run("--not-corrected --field " + field);
    EXPECT_EQ(run.exit_code, 2) << run.out;
    return run.err;
  };
  EXPECT_NE(error("one.nrrd").find("holds B0 of one read-out"), std::string::npos);
  write(files.folder, "scans.toml", read_out); // L, the field R
  EXPECT_NE(error("one.nrrd").find("measured with the opposite read-out"), std::string::npos);
  write(files.folder, "scans.toml", read_out + "foreground_opposed = \"on_opposed.nrrd\"\n");
  EXPECT_NE(error("both.nrrd").find("background_opposed"), std::string::npos);
  write(files.folder, "scans.toml", "read_out = \"X\"\nbandwidth_Hz = 260\n" + kScans);
  EXPECT_NE(error("both.nrrd").find("read_out \"X\""), std::string::npos);
}

TEST(MriRegister, RefusalsAreExitCode1AndSayWhy) {
  const Files files;
  const auto reason = [&](const std::string &more = "--json") {
    const auto run = files.run(more);
    EXPECT_EQ(run.exit_code, 1) << run.out << run.err;
    const auto json = run.json();
    EXPECT_TRUE(json.contains("T_base_device") && json["T_base_device"].is_null()) << run.out;
    return json["reason"].get<std::string>();
  };
  save(files.folder, "on.nrrd", drawn(places(files.frame, {0, 1, 2}, kPlaced), 6.0, 2));
  EXPECT_NE(reason().find("fewer than four"), std::string::npos);
  save(files.folder, "on.nrrd", drawn({}, 0, 2, 0.5));
  EXPECT_NE(reason().find("not the same protocol"), std::string::npos);
  // No coil is left to register.
  save(files.folder, "on.nrrd", drawn(places(files.frame, {0, 1, 2, 3, 4, 5}, kPlaced), 6.0, 2));
  write(files.folder, "scans.toml", kScans + "verify = [\"a\", \"b\"]\n");
  EXPECT_NE(reason().find("only 0 of the coils that are seen register"), std::string::npos);
  write(files.folder, "scans.toml", kScans);
  // Mounted otherwise than its file states.
  save(files.folder, "on.nrrd", drawn(places(files.frame, {0, 1, 2, 3, 4, 5}, kPlaced), 6.0, 2));
  write(files.folder, "frame.toml",
        "x_points_to = \"P\"\nz_points_to = \"L\"\n" + casefile::coil_frame_text(files.frame));
  const auto run = files.run("--json");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.json()["reason"].get<std::string>().find("from where it is mounted"), std::string::npos) << run.out;
}

TEST(MriRegister, WrongFilesAreExitCode2AndNameTheValue) {
  const Files files;
  const auto error = [&] {
    const auto run = files.run();
    EXPECT_EQ(run.exit_code, 2) << run.out;
    EXPECT_EQ(run.out, "");
    return run.err;
  };
  write(files.folder, "scans.toml", kScans + "verify = [\"c\"]\n");
  EXPECT_NE(error().find("\"c\" is no coil and no group of the frame small"), std::string::npos);
  write(files.folder, "scans.toml", kScans.substr(kScans.find('\n') + 1));
  EXPECT_NE(error().find("frame: is"), std::string::npos);
  std::string some = kScans;
  some.replace(some.find("\"a\", \"b\""), 8, "\"a\"");
  write(files.folder, "scans.toml", some + "verify = [\"b1\"]\n");
  EXPECT_NE(error().find("b1 is not on in this scan"), std::string::npos);
  write(files.folder, "scans.toml", kScans + "opposite = \"on.nrrd\"\n");
  EXPECT_NE(error().find("scans[0].foreground and scans[0].opposite are the same image"), std::string::npos);
  std::string coronal = kScans;
  coronal.replace(coronal.find("\"T\""), 3, "\"X9\"");
  write(files.folder, "scans.toml", coronal);
  EXPECT_NE(error().find("orientation"), std::string::npos);
  write(files.folder, "scans.toml", "frame = \"nothing.toml\"\n");
  EXPECT_NE(error().find("nothing.toml"), std::string::npos);
  write(files.folder, "scans.toml", kScans);
  Stack lost = drawn(places(files.frame, {0, 1, 2, 3, 4, 5}, kPlaced), 6.0, 2);
  const auto slice = static_cast<std::ptrdiff_t>(lost.offset(0, 0, 1));
  std::copy_backward(lost.voxels.begin() + 50 * slice, lost.voxels.end() - slice, lost.voxels.end());
  save(files.folder, "on.nrrd", lost);
  EXPECT_NE(error().find("have the same pixels: one was lost"), std::string::npos) << error();
  std::filesystem::remove(files.folder.path() / "on.nrrd");
  EXPECT_NE(error().find("on.nrrd"), std::string::npos);
}

TEST(MriRegister, ASeriesInAnotherOrientationThanListedIsAnError) {
  const Files files;
  Stack oblique = drawn({}, 0, 1);
  oblique.T_image_index.topLeftCorner<3, 3>() =
      geometry::rotation_exp(Vector3d(0.3, 0, 0)).toRotationMatrix() * oblique.T_image_index.topLeftCorner<3, 3>();
  save(files.folder, "off.nrrd", oblique);
  const auto run = files.run();
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_NE(run.err.find("its slices are not in the orientation T"), std::string::npos) << run.err;
}

TEST(MriRegister, SlicesThatAreListedInAnotherOfTheirAxesAreAnError) {
  const Files files;
  for (const char *name : {"off.nrrd", "on.nrrd"}) {
    auto stack = casefile::read_volume(files.folder.path() / name);
    ASSERT_TRUE(stack.has_value());
    stack->T_image_index.col(2) *= 1.1; // slices of 1.65 mm
    ASSERT_TRUE(casefile::write_volume(files.folder.path() / name, *stack).has_value());
  }
  std::string sagittal = kScans;
  sagittal.replace(sagittal.find("\"T\""), 3, "\"S\"");
  write(files.folder, "scans.toml", sagittal);
  const auto run = files.run();
  EXPECT_EQ(run.exit_code, 2) << run.out;
  EXPECT_NE(run.err.find("its pixels are square in the orientation T, so its slices are not in the orientation S"),
            std::string::npos)
      << run.err;
}

TEST(CoilFrames, ReadBackAsWrittenAndRefuseByName) {
  const TemporaryFolder folder;
  CoilFrame frame = small_frame();
  Eigen::Matrix3d mounted;
  mounted << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  frame.R_patient_base = mounted;
  write(folder, "frame.toml", casefile::coil_frame_text(frame));
  const auto read = casefile::read_coil_frame(folder.path() / "frame.toml");
  ASSERT_TRUE(read.has_value()) << read.error().message;
  ASSERT_EQ(read->coils.size(), frame.coils.size());
  for (std::size_t i = 0; i < frame.coils.size(); ++i) {
    EXPECT_EQ(read->coils[i].name, frame.coils[i].name);
    EXPECT_EQ(read->coils[i].group, frame.coils[i].group);
    EXPECT_EQ(read->coils[i].position_mm, frame.coils[i].position_mm);
  }
  ASSERT_TRUE(read->R_patient_base.has_value());
  EXPECT_EQ(*read->R_patient_base, mounted);

  const auto refused = [&](const std::string &text) {
    write(folder, "bad.toml", text);
    const auto bad = casefile::read_coil_frame(folder.path() / "bad.toml");
    return bad ? std::string("accepted") : bad.error().message;
  };
  const std::string good = casefile::coil_frame_text(frame);
  EXPECT_NE(refused(good + "[[coils]]\nname = \"a1\"\nposition_mm = [0, 0, 99]\n").find("appears twice"),
            std::string::npos);
  EXPECT_NE(refused(good + "[[coils]]\nname = \"z\"\nposition_mm = [-50, -45, 30]\n").find("is the place of a1"),
            std::string::npos);
  // Words that a pattern could not name, or that would name more.
  for (const char *word : {"background", "a+b", "", " z"}) {
    EXPECT_NE(
        refused(good + "[[coils]]\nname = \"" + word + "\"\ngroup = \"g\"\nposition_mm = [0, 0, 99]\n").find("name"),
        std::string::npos)
        << word;
  }
  EXPECT_NE(refused(good + "[[coils]]\nname = \"a\"\nposition_mm = [0, 0, 99]\n").find("is the group of a1"),
            std::string::npos);
  EXPECT_NE(
      refused(good + "[[coils]]\nname = \"z\"\ngroup = \"a1\"\nposition_mm = [0, 0, 99]\n").find("is the coil a1"),
      std::string::npos);
  EXPECT_NE(refused("name = \"x\"\nx_points_to = \"L\"\n").find("belong together"), std::string::npos);
  EXPECT_NE(refused("name = \"x\"\n").find("at least four"), std::string::npos);
}

} // namespace bregma::mri::test
