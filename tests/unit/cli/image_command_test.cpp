// `bregma image` on files: what it writes, and what a person reads where images cannot be registered.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "casefile/case.hpp"
#include "casefile/itk_transform.hpp"
#include "casefile/markups.hpp"
#include "casefile/volumes/volume.hpp"
#include "tests/unit/algorithms/intensity/phantom.hpp"
#include "tests/unit/casefile/sample_case.hpp"
#include "tests/unit/cli/run_bregma.hpp"
#include "tests/unit/volumes/dicom_slices.hpp"

namespace {

using namespace bregma;
using bregma::tests::run_bregma;
using test::TemporaryFolder;

constexpr double kScale = 2.6; // of the phantom: to the size of a head

casefile::Volume head(std::array<int, 3> size, bool other,
                      const Eigen::Matrix4d &T_header = Eigen::Matrix4d::Identity()) {
  Eigen::Affine3d to_body = Eigen::Affine3d::Identity();
  to_body.scale(1.0 / kScale);
  casefile::Volume out = test::phantom(size, {3.3, 3.3, 3.3}, to_body);
  if (other) {
    for (std::size_t i = 0; i < out.voxels.size(); ++i) {
      out.voxels[i] = 90.0F * std::sin(out.voxels[i] / 45.0F) + static_cast<float>(i % 7);
    }
  }
  out.T_image_index = (T_header * out.T_image_index).eval();
  return out;
}

struct Files {
  TemporaryFolder folder;
  Files() {
    write("target.nii.gz", head({50, 58, 46}, false));
    write("source.nii.gz", head({48, 56, 48}, true, test::pose({5, -8, 12}, {12, -7, 9})));
  }
  void write(const std::string &name, const casefile::Volume &volume) const {
    ASSERT_TRUE(casefile::write_volume(folder.path() / name, volume).has_value());
  }
  [[nodiscard]] tests::Outcome run(const std::string &arguments) const { return run_bregma(folder, arguments); }
};

TEST(ImageCommand, RegistersTwoImagesAndWritesWhatIsAskedFor) {
  const Files files;
  const auto run = files.run("image register source.nii.gz target.nii.gz --finest-mm 3.3 --tfm out.tfm "
                             "--resampled moved.nii.gz --picture check.png --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto out = run.json();
  EXPECT_EQ(out["verdict"], "found");
  EXPECT_GT(out["lead"].get<double>(), 0.15);
  EXPECT_EQ(out["targets"].size(), 4U);
  const auto T = casefile::read_itk_rigid(files.folder.path() / "out.tfm");
  ASSERT_TRUE(T.has_value());
  const Eigen::Matrix4d truth = test::pose({5, -8, 12}, {12, -7, 9}).inverse();
  EXPECT_LT((T->matrix() - truth).topRightCorner(3, 1).norm(), 0.5);
  EXPECT_LT((T->matrix() - truth).topLeftCorner(3, 3).norm(), 0.01);
  const auto moved = casefile::read_volume(files.folder.path() / "moved.nii.gz");
  ASSERT_TRUE(moved.has_value()) << moved.error().message;
  EXPECT_EQ(moved->size, (std::array<int, 3>{50, 58, 46}));
  EXPECT_EQ(tests::read_file((files.folder.path() / "check.png").string()).substr(1, 3), "PNG");
  const auto text = files.run("image register source.nii.gz target.nii.gz --finest-mm 3.3");
  EXPECT_NE(text.out.find("T_target_source"), std::string::npos) << text.out;
  EXPECT_NE(text.out.find("perturbed restarts came back"), std::string::npos) << text.out;
}

TEST(ImageCommand, RefusesWithAReasonAndWritesNothing) {
  const Files files;
  files.write("slice.nii.gz", head({48, 56, 1}, true));
  casefile::Volume flat = head({48, 56, 48}, true);
  std::fill(flat.voxels.begin(), flat.voxels.end(), 4.0F);
  files.write("flat.nii.gz", flat);
  files.write("far.nii.gz", head({48, 56, 48}, true, test::pose({0, 0, 0}, {0, 0, 2000})));
  const auto reason = [&](const std::string &arguments) {
    const auto run = files.run("image register " + arguments + " target.nii.gz --tfm no.tfm --resampled no.nii");
    EXPECT_EQ(run.exit_code, 1);
    EXPECT_EQ(run.out, "");
    EXPECT_FALSE(std::ifstream(files.folder.path() / "no.tfm").good());
    EXPECT_FALSE(std::ifstream(files.folder.path() / "no.nii").good());
    return run.err;
  };
  const auto json = files.run("image register --start header far.nii.gz target.nii.gz --json").json();
  EXPECT_TRUE(json.contains("T_target_source") && json["T_target_source"].is_null() && json["covariance"].is_null());
  EXPECT_NE(reason("slice.nii.gz").find("bregma: refused: the floating image has 1 slice along an axis"),
            std::string::npos);
  EXPECT_NE(reason("flat.nii.gz").find("bregma: refused: the floating image has one grey value only"),
            std::string::npos);
  EXPECT_NE(reason("--start header far.nii.gz")
                .find("bregma: refused: the images do not overlap where their headers place them"),
            std::string::npos);
}

// From two images to a target of the second one in the case, and what does not enter.
TEST(ImageCommand, ARegisteredImageBecomesPartOfACase) {
  const Files files;
  const std::filesystem::path folder = files.folder.path() / "case";
  std::filesystem::create_directories(folder);
  std::filesystem::copy_file(files.folder.path() / "target.nii.gz", folder / "image.nii.gz");
  ASSERT_TRUE(casefile::save_case(tests::sample_case(folder)));
  const geometry::Rigid3<geometry::frame::Image, geometry::frame::Source> truth(
      test::pose({5, -8, 12}, {12, -7, 9}).inverse().topLeftCorner<3, 3>(),
      test::pose({5, -8, 12}, {12, -7, 9}).inverse().topRightCorner<3, 1>());
  const Eigen::Vector3d cyst(12.0, 3.0, 25.0); // in the planning image
  const std::vector<casefile::NamedPoint> placed{{"Cyst", truth.inverse() * cyst}};
  ASSERT_TRUE(casefile::write_points(files.folder.path() / "on_t2.mrk.json", "targets", placed));

  ASSERT_EQ(files.run("image register source.nii.gz case/image.nii.gz --finest-mm 3.3 --result t2.json").exit_code, 0);
  const auto added = files.run("image add case source.nii.gz --result t2.json --name T2 --targets on_t2.mrk.json");
  ASSERT_EQ(added.exit_code, 0) << added.err;
  EXPECT_NE(added.out.find("in its coordinates: target Cyst"), std::string::npos) << added.out;
  const auto loaded = casefile::load_case(folder);
  ASSERT_TRUE(loaded) << loaded.error().message;
  const casefile::NamedPoint &target = loaded->targets.back();
  EXPECT_LT((target.position_mm - cyst).norm(), 0.5);
  const double rms = std::sqrt(target.placing_covariance_mm2.trace());
  EXPECT_GT(rms, 0.01);
  EXPECT_LT(rms, 3.0);

  const auto refusal = [&](const std::string &arguments, const std::string &part) {
    const auto run = files.run("image " + arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments;
    EXPECT_NE(run.err.find(part), std::string::npos) << run.err;
  };
  refusal("add case source.nii.gz --result t2.json --name T2", "the case has an image \"T2\"; --replace replaces it");
  refusal("add case target.nii.gz --result t2.json --name PD", "is not the image that was registered");
  refusal("add case source.nii.gz --transform t2.json --name PD", "--accept why the transform is used, in words");
  refusal("add case source.nii.gz --result on_t2.mrk.json --name PD", "T_target_source: must be a matrix of 4 x 4");
  refusal("register source.nii.gz target.nii.gz --into case", "give both or none");
  refusal("remove case FLAIR", "the case has no image \"FLAIR\"");
  refusal("remove case T2", "--with-plans removes them too");
  EXPECT_EQ(files.run("image list case --json").json()[0]["placed_in_it"][0], "target Cyst");

  ASSERT_TRUE(casefile::write_itk_transform(files.folder.path() / "other.tfm", truth.matrix()));
  const auto words = files.run("image add case source.nii.gz --transform other.tfm --error-mm 0.8 --accept "
                               "'compared by eye' --name T2 --replace --json");
  ASSERT_EQ(words.exit_code, 0) << words.err;
  EXPECT_EQ(words.json()["accepted"], "compared by eye");
  EXPECT_NEAR(words.json()["error_rms_mm"].get<double>(), 0.8, 1e-6);
  EXPECT_LT((casefile::load_case(folder)->targets.back().position_mm - cyst).norm(), 1e-6) << "moved with it";
  EXPECT_EQ(files.run("image remove case T2 --with-plans").exit_code, 0);
  EXPECT_EQ(casefile::load_case(folder)->targets.size(), 1U);
}

// A structure that was segmented on the second image's grid lies where the registration puts it, and names the image.
TEST(ImageCommand, ASegmentationOnTheSecondImagesGridEntersTheCase) {
  const Files files;
  const std::filesystem::path folder = files.folder.path() / "case";
  std::filesystem::create_directories(folder);
  std::filesystem::copy_file(files.folder.path() / "target.nii.gz", folder / "image.nii.gz");
  ASSERT_TRUE(casefile::save_case(tests::sample_case(folder)));
  const Eigen::Matrix4d T_t2_planning = test::pose({5, -8, 12}, {12, -7, 9});
  ASSERT_TRUE(casefile::write_itk_transform(files.folder.path() / "t2.tfm", T_t2_planning.inverse()));
  const Eigen::Vector3d centre(15.0, 10.0, -5.0); // of a ball, in the planning image
  constexpr double kRadius_mm = 14.0;
  casefile::Volume labels = head({48, 56, 48}, true, T_t2_planning);
  const Eigen::Vector3d in_t2 = (T_t2_planning * centre.homogeneous()).head<3>();
  for (std::size_t i = 0; i < labels.voxels.size(); ++i) {
    labels.voxels[i] = (labels.pixel_mm(i) - in_t2).norm() < kRadius_mm ? 3.0F : 0.0F;
  }
  files.write("vessels.nii.gz", labels);
  const std::string add = "image add case source.nii.gz --transform t2.tfm --error-mm 0.6 --accept 'compared by eye' "
                          "--name T2 --labels vessels.nii.gz --structure ";
  EXPECT_NE(files.run(add + "Vessel=7").err.find("surface \"Vessel\""), std::string::npos);
  const auto added = files.run(add + "Vessel=3");
  ASSERT_EQ(added.exit_code, 0) << added.err;
  EXPECT_NE(added.out.find("in its coordinates: structure Vessel"), std::string::npos) << added.out;
  const auto loaded = casefile::load_case(folder);
  ASSERT_TRUE(loaded) << loaded.error().message;
  const casefile::Surface &vessel = loaded->structures.back();
  EXPECT_EQ(vessel.name + " " + vessel.segmented_in, "Vessel T2");
  for (const Eigen::Vector3d &vertex : vessel.mesh.vertices_mm) {
    ASSERT_NEAR((vertex - centre).norm(), kRadius_mm, 2.5) << "voxels of 3.3 mm";
  }
  // A brain that was made on it, too, and what needs that brain: all of it is named, and removed only if wanted.
  casefile::Case with_brain = *loaded;
  with_brain.brain.segmented_in = "T2";
  with_brain.craniotomy = {.trajectory = "Biopsy", .radius_mm = std::nullopt};
  ASSERT_TRUE(casefile::save_case(with_brain));
  EXPECT_EQ(files.run("image remove case T2").err,
            "bregma: case: placed or made in image \"T2\": structure Vessel, the brain, brain landmark Anterior "
            "commissure, the planned craniotomy; --with-plans removes them too\n");
  const auto removed = files.run("image remove case T2 --with-plans");
  EXPECT_EQ(removed.exit_code, 0) << removed.err;
  EXPECT_NE(removed.out.find("removed with it: the brain\n"), std::string::npos) << removed.out;
  const auto after = casefile::load_case(folder);
  ASSERT_TRUE(after) << after.error().message;
  EXPECT_EQ(after->structures.size(), loaded->structures.size() - 1);
  EXPECT_TRUE(after->brain.mesh.triangles.empty());
  EXPECT_FALSE(after->craniotomy);
  EXPECT_TRUE(after->brain_landmarks.empty());
}

TEST(ImageCommand, MasksLeaveOutWhatTheTwoImagesDoNotShare) {
  const Files files;
  // A frame around the head of the target only, bright enough to take most of the grey values.
  casefile::Volume framed = head({50, 58, 46}, false);
  casefile::Volume mask = framed;
  for (std::size_t i = 0; i < framed.voxels.size(); ++i) {
    const Eigen::Vector3d p = framed.pixel_mm(i);
    const bool frame = std::max(std::abs(p.x()) / 78.0, std::abs(p.y()) / 88.0) > 0.97;
    framed.voxels[i] = frame ? static_cast<float>(60 + (i * 7919) % 90) : framed.voxels[i];
    mask.voxels[i] = frame ? 0.0F : 1.0F;
  }
  files.write("framed.nii.gz", framed);
  files.write("mask.nii.gz", mask);
  const auto run = files.run("image register source.nii.gz framed.nii.gz --start centres --finest-mm 3.3 "
                             "--fixed-mask mask.nii.gz --tfm out.tfm --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto T = casefile::read_itk_rigid(files.folder.path() / "out.tfm");
  ASSERT_TRUE(T.has_value());
  const Eigen::Matrix4d truth = test::pose({5, -8, 12}, {12, -7, 9}).inverse();
  EXPECT_LT((T->matrix() - truth).topRightCorner(3, 1).norm(), 0.7);
}

// Outside the circle of both scans; as grey values, the two circles would be what is registered.
TEST(ImageCommand, PaddingIsNotCompared) {
  const Files files;
  const auto padded = [](casefile::Volume image) {
    const Eigen::Vector3d centre = image.point_mm(0.5 * Eigen::Vector3d(image.size[0] - 1, image.size[1] - 1, 0));
    for (std::size_t i = 0; i < image.voxels.size(); ++i) {
      const bool outside = (image.pixel_mm(i) - centre).head<2>().norm() > 1.65 * image.size[0];
      image.voxels[i] = outside ? -2000.0F : image.voxels[i];
    }
    return image;
  };
  files.write("target.nii.gz", padded(head({50, 58, 46}, false)));
  files.write("source.nii.gz", padded(head({48, 56, 48}, true, test::pose({0, 0, 12}, {12, -7, 9}))));
  const auto run = files.run("image register source.nii.gz target.nii.gz --start centres --finest-mm 3.3 --tfm out.tfm "
                             "--json");
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out;
  EXPECT_NE(run.json()["notes"][0].get<std::string>().find("voxels are padding (-2000)"), std::string::npos);
  const auto T = casefile::read_itk_rigid(files.folder.path() / "out.tfm");
  ASSERT_TRUE(T.has_value());
  const Eigen::Matrix4d truth = test::pose({0, 0, 12}, {12, -7, 9}).inverse();
  EXPECT_LT((T->matrix() - truth).topRightCorner(3, 1).norm(), 0.7);
}

TEST(ImageCommand, RefusesMasksThatDoNotFit) {
  const Files files;
  const auto error = [&](const std::string &name, const casefile::Volume &mask, const std::string &option) {
    files.write(name, mask);
    const auto run = files.run("image register source.nii.gz target.nii.gz " + option + " " + name);
    EXPECT_EQ(run.exit_code, 2);
    return run.err;
  };
  casefile::Volume ones = head({50, 58, 46}, false);
  std::fill(ones.voxels.begin(), ones.voxels.end(), 1.0F);
  EXPECT_NE(error("ones.nii.gz", ones, "--moving-mask")
                .find("ones.nii.gz: a mask must have the voxels of its image, and this one (50 x 58 x 46) does not lie "
                      "on those of source.nii.gz (48 x 56 x 48)"),
            std::string::npos);
  casefile::Volume empty = ones;
  std::fill(empty.voxels.begin(), empty.voxels.end(), 0.0F);
  EXPECT_NE(error("empty.nii.gz", empty, "--fixed-mask").find("every voxel is 0, so nothing remains to compare"),
            std::string::npos);
  casefile::Volume grey = ones;
  grey.voxels[5] = 0.4F;
  EXPECT_NE(error("grey.nii.gz", grey, "--fixed-mask").find("grey.nii.gz"), std::string::npos);
}

TEST(ImageCommand, WhatIsNotTheSameHeadIsNotFound) {
  const Files files;
  const auto verdict = [&](const std::string &name, const casefile::Volume &volume) {
    files.write(name, volume);
    const auto run = files.run("image register " + name + " target.nii.gz --finest-mm 3.3 --json");
    EXPECT_EQ(run.exit_code, 1) << name << run.out;
    const auto out = run.json();
    EXPECT_FALSE(out["reason"].get<std::string>().empty());
    EXPECT_TRUE(out.at("T_target_source").is_null());
    return out["verdict"].get<std::string>() + ": " + out["reason"].get<std::string>();
  };
  // Another body part: smooth blobs elsewhere.
  casefile::Volume other = head({48, 56, 48}, false);
  for (std::size_t i = 0; i < other.voxels.size(); ++i) {
    const Eigen::Vector3d p = other.pixel_mm(i);
    other.voxels[i] =
        static_cast<float>(60.0 * std::exp(-(p.head<2>() - Eigen::Vector2d(20, 10)).squaredNorm() / 500.0) +
                           80.0 * std::exp(-(p.head<2>() - Eigen::Vector2d(-35, -20)).squaredNorm() / 300.0) +
                           static_cast<double>((i * 7919) % 11));
  }
  verdict("other.nii.gz", other);
  // The same head with left and right exchanged, as by an export that loses the sign of an axis: it is nearly as
  // symmetric as a head, and without a test of the mirror image it would be found.
  casefile::Volume mirrored = head({48, 56, 48}, true);
  for (auto row = mirrored.voxels.begin(); row != mirrored.voxels.end(); row += mirrored.size[0]) {
    std::reverse(row, row + mirrored.size[0]);
  }
  EXPECT_NE(verdict("mirrored.nii.gz", mirrored).find("ambiguous: "), std::string::npos);
  casefile::Volume noise = head({48, 56, 48}, true);
  for (std::size_t i = 0; i < noise.voxels.size(); ++i) {
    noise.voxels[i] = static_cast<float>((i * 2654435761U >> 7U) % 251);
  }
  verdict("noise.nii.gz", noise);
}

// A header that is turned is not wrong in itself: the pose is searched among all rotations. From the header alone it is
// out of reach, and then it is not "found".
TEST(ImageCommand, AWrongOrientationIsFoundBySearchAndNotFromTheHeader) {
  const Files files;
  for (const Eigen::Vector3d &turn : {Eigen::Vector3d(90, 0, 0), Eigen::Vector3d(0, 0, 180)}) {
    const Eigen::Matrix4d T = test::pose(turn, {0, 0, 0});
    files.write("turned.nii.gz", head({48, 56, 48}, true, T));
    const std::string words = "image register turned.nii.gz target.nii.gz --finest-mm 3.3 --tfm out.tfm --json";
    const auto searched = files.run(words);
    ASSERT_EQ(searched.exit_code, 0) << searched.out;
    const auto found = casefile::read_itk_rigid(files.folder.path() / "out.tfm");
    ASSERT_TRUE(found.has_value());
    EXPECT_LT((found->matrix() - T.inverse()).topLeftCorner(3, 3).norm(), 0.02);
    std::filesystem::remove(files.folder.path() / "out.tfm");
    const auto near = files.run(words + " --start header");
    EXPECT_EQ(near.exit_code, 1) << near.out;
    EXPECT_NE(near.json()["verdict"], "found");
    EXPECT_FALSE(near.json()["reason"].get<std::string>().empty());
    EXPECT_FALSE(std::filesystem::exists(files.folder.path() / "out.tfm"));
  }
}

TEST(ImageCommand, ADicomSeriesIsRegistered) {
  const Files files;
  casefile::Volume source = head({48, 56, 48}, true);
  for (float &v : source.voxels) {
    v = 100.0F * (v + 100.0F); // whole numbers, not negative
  }
  test::write_dicom(files.folder.path() / "dicom", source);
  const auto run = files.run("image register dicom target.nii.gz --finest-mm 3.3 --tfm out.tfm --json");
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out;
  const auto T = casefile::read_itk_rigid(files.folder.path() / "out.tfm");
  ASSERT_TRUE(T.has_value());
  EXPECT_LT((T->matrix() - Eigen::Matrix4d::Identity()).topRightCorner(3, 1).norm(), 0.5);
  EXPECT_LT((T->matrix() - Eigen::Matrix4d::Identity()).topLeftCorner(3, 3).norm(), 0.01);

  // The same voxels under another name: said, without the names.
  std::filesystem::copy(files.folder.path() / "dicom", files.folder.path() / "other");
  for (const auto &slice : std::filesystem::directory_iterator(files.folder.path() / "other")) {
    std::string bytes = tests::read_file(slice.path().string());
    bytes.replace(bytes.find("Doe^Jane"), 8, "Roe^Anna");
    std::ofstream(slice.path(), std::ios::binary) << bytes;
  }
  const auto two = files.run("image register other dicom --start header --finest-mm 4");
  EXPECT_NE(two.notes.find("the DICOM headers of the two images differ in: name. "), std::string::npos) << two.notes;
  EXPECT_EQ(two.notes.find("Anna"), std::string::npos);
  EXPECT_EQ(files.run("image register dicom dicom --start header --finest-mm 4").notes.find("differ in"),
            std::string::npos);
}

// A head that was bent smoothly and posed: the field leads back to it. Its error is not predicted, so it is no
// registration of a case.
TEST(ImageCommand, NonrigidWritesAFieldAndIsNoRegistrationOfACase) {
  const Files files;
  const Eigen::Matrix4d T_source_target = test::pose({3, -2, 4}, {6, -4, 5});
  const auto bend = [](const Eigen::Vector3d &p) -> Eigen::Vector3d { // of a point of the target, mm
    return p + 5.0 * Eigen::Vector3d(1, 0.5, -0.5) * std::exp(-p.squaredNorm() / (2.0 * 30.0 * 30.0));
  };
  // Where a point of the bent head is in the head as it was, by fixed-point iteration.
  const auto unbend = [&bend](const Eigen::Vector3d &q) {
    Eigen::Vector3d p = q;
    for (int i = 0; i < 20; ++i) {
      p += q - bend(p);
    }
    return p;
  };
  casefile::Volume source = head({48, 56, 48}, true, T_source_target);
  const Eigen::Matrix4d back = T_source_target.inverse();
  for (std::size_t i = 0; i < source.voxels.size(); ++i) {
    const Eigen::Vector3d q = (back * source.pixel_mm(i).homogeneous()).head<3>();
    source.voxels[i] = 90.0F * std::sin(test::phantom_grey(unbend(q) / kScale) / 45.0F);
  }
  files.write("bent.nii.gz", source);
  const std::string words = "image register bent.nii.gz target.nii.gz --start centres --nonrigid ";
  const auto run = files.run(words + "--finest-mm 3.3 --field field.nrrd --resampled moved.nii.gz --json");
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out;
  const auto out = run.json();
  EXPECT_TRUE(out["nonrigid"]["found"]);
  EXPECT_GT(out["nonrigid"]["smallest_jacobian"], 0.3);
  EXPECT_GT(out["nonrigid"]["mf_mi"], out["nonrigid"]["mf_mi_before"]);
  EXPECT_FALSE(out.contains("covariance")) << "that of the rigid pose is not the error of the deformation";
  EXPECT_FALSE(out.contains("targets"));
  EXPECT_TRUE(tests::read_file(files.folder.path() / "field.nrrd").starts_with("NRRD"));
  // The source on the target's grid, beside what the source would show there: in the brain, where the head was bent.
  ASSERT_EQ(
      files.run("image register bent.nii.gz target.nii.gz --start centres --finest-mm 3.3 --resampled rigid.nii.gz")
          .exit_code,
      0);
  const casefile::Volume target = head({50, 58, 46}, false);
  const auto residual = [&](const char *name) {
    const auto moved = casefile::read_volume(files.folder.path() / name);
    EXPECT_TRUE(moved) << name;
    double sum = 0.0;
    int count = 0;
    for (std::size_t i = 0; moved && i < target.pixels(); ++i) {
      const Eigen::Vector3d p = target.pixel_mm(i);
      if ((p / kScale).cwiseQuotient(Eigen::Vector3d(22, 26, 20)).norm() < 0.9) {
        sum += std::pow(static_cast<double>(moved->voxels[i] - 90.0F * std::sin(target.voxels[i] / 45.0F)), 2);
        ++count;
      }
    }
    return std::sqrt(sum / count);
  };
  EXPECT_LT(residual("moved.nii.gz"), 0.5 * residual("rigid.nii.gz"));

  EXPECT_NE(files.run(words + "--finest-mm 4").out.find("Its error is not predicted: not for navigation"),
            std::string::npos);
  const auto into = files.run(words + "--into case --name Later");
  EXPECT_EQ(into.exit_code, 2);
  EXPECT_NE(into.err.find("its registration is rigid; leave out --affine and --nonrigid"), std::string::npos);
  EXPECT_EQ(files.run(words + "--result bent.json").exit_code, 2);
  EXPECT_NE(
      files.run("image add case bent.nii.gz --transform field.nrrd --error-mm 1 --accept 'x' --name Later").exit_code,
      0);
  EXPECT_EQ(files.run("image register bent.nii.gz target.nii.gz --field f.nrrd").exit_code, 2) << "needs --nonrigid";
}

TEST(ImageCommand, ImagesThatAreNoVolumesCannotBeRead) {
  const Files files;
  std::ofstream(files.folder.path() / "four.mha")
      << "ObjectType = Image\nNDims = 4\nDimSize = 2 2 2 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
      << std::string(16, 'a');
  std::ofstream(files.folder.path() / "colour.mha") << "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementSpacing "
                                                       "= 1 1 1\nElementNumberOfChannels = 3\nElementType = MET_UCHAR\n"
                                                       "ElementDataFile = LOCAL\n"
                                                    << std::string(24, 'a');
  for (const auto &[name, reason] : {std::pair{"four.mha", "a volume has three dimensions"},
                                     {"colour.mha", "3 components (colour or vector)"},
                                     {"absent.nii", "no such file"}}) {
    for (const std::string &pair : {std::string(name) + " target.nii.gz", std::string("source.nii.gz ") + name}) {
      const auto run = files.run("image register " + pair);
      EXPECT_EQ(run.exit_code, 2) << name;
      EXPECT_NE(run.err.find(std::string(name) + ": "), std::string::npos) << run.err;
      EXPECT_NE(run.err.find(reason), std::string::npos) << run.err;
    }
  }
  EXPECT_EQ(files.run("image register source.nii.gz target.nii.gz --tfm source.nii.gz").exit_code, 2);
}

TEST(ImageCommand, ProfileFindsThePoseAndWritesCurves) {
  const Files files;
  files.write("turned.nii.gz", head({48, 56, 48}, true, test::pose({0, 0, 6}, {0, 0, 0})));
  const auto run = files.run("image profile turned.nii.gz target.nii.gz --measure nmi,ami --from -15 --to 15 --step 1 "
                             "--csv curve.csv --plot curve.svg --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto out = run.json();
  EXPECT_EQ(out["at"].size(), 31U);
  EXPECT_NEAR(out["largest_at"]["nmi"].get<double>(), 6.0, 1.0);
  EXPECT_NEAR(out["largest_at"]["ami"].get<double>(), 6.0, 1.0);
  const std::string csv = tests::read_file((files.folder.path() / "curve.csv").string());
  EXPECT_TRUE(csv.starts_with("rotation-z_deg,nmi,ami\n-15.0000,")) << csv.substr(0, 60);
  EXPECT_NE(tests::read_file((files.folder.path() / "curve.svg").string()).find("<svg"), std::string::npos);
  EXPECT_EQ(files.run("image profile source.nii.gz target.nii.gz --from 0 --to 5000 --step 1").err,
            "bregma: --from, --to, --step: 5001 steps; 1 to 2000 are possible\n");
  const auto cut = files.run("image profile turned.nii.gz target.nii.gz --from -15 --to 2 --step 1");
  EXPECT_NE(cut.notes.find("nmi: largest at the end of the range"), std::string::npos) << cut.notes;
}

TEST(ImageCommand, ProfileAndFeaturesRefuseOneGreyValueAndOtherPictures) {
  const Files files;
  casefile::Volume flat = head({24, 28, 24}, false);
  std::fill(flat.voxels.begin(), flat.voxels.end(), 7.0F);
  files.write("flat.nii.gz", flat);
  const std::string reason = "flat.nii.gz: the image has one grey value only: there is nothing to compare";
  for (const std::string words : {"profile flat.nii.gz target.nii.gz", "profile source.nii.gz flat.nii.gz",
                                  "features flat.nii.gz --picture flat.png"}) {
    const auto run = files.run("image " + words);
    EXPECT_EQ(run.exit_code, 2) << words;
    EXPECT_NE(run.err.find(reason), std::string::npos) << run.err;
  }
  EXPECT_FALSE(std::filesystem::exists(files.folder.path() / "flat.png"));
  for (const std::string words : {"features source.nii.gz", "register source.nii.gz target.nii.gz"}) {
    EXPECT_EQ(files.run("image " + words + " --picture look.jpg").err,
              "bregma: --picture look.jpg: pictures are written as .png only\n");
  }
}

TEST(ImageCommand, FeaturesShowThatAigAsPrintedIsNearlyZero) {
  const Files files;
  const auto printed = files.run("image features source.nii.gz --reading printed --json").json();
  EXPECT_GT(printed["zero_fraction"].get<double>(), 0.99);
  const auto reading = files.run("image features source.nii.gz --out aig.nii.gz --picture aig.png --json").json();
  EXPECT_LT(reading["zero_fraction"].get<double>(), 0.9);
  EXPECT_TRUE(casefile::read_volume(files.folder.path() / "aig.nii.gz").has_value());
}

TEST(FullOutput, ALostImageRegistrationIsNoSuccess) {
  const Files files;
  for (const char *command : {"image register source.nii.gz target.nii.gz --finest-mm 4 --start centres",
                              "image profile source.nii.gz target.nii.gz", "image features source.nii.gz"}) {
    tests::expect_lost_output_is_said(files.folder, command);
  }
}

} // namespace
