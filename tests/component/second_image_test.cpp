// From two images of a head to a target that was planned in the second one and is navigated: the program `bregma`, the
// real daemon and the simulated room.
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/uncertainty/tre.hpp"
#include "casefile/markups.hpp"
#include "casefile/volumes/volume.hpp"
#include "idl/names.hpp"
#include "tests/component/operation_fixture.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/algorithms/intensity/phantom.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace bregma::test {
namespace {

constexpr double kScale = 2.6; // of the phantom: to the size of a head
constexpr double kSpacing_mm = 4.0;
const Eigen::Matrix4d kT2FromPlanning = pose({4, -6, 9}, {9, -5, 7});
const Eigen::Vector3d kCyst_mm = kHeadCentre + Eigen::Vector3d(-12, 10, 8); // in the planning image
const Eigen::Vector3d kEntry_mm = on_head(Eigen::Vector3d(-0.35, 0.5, 0.8));
const Eigen::Vector3d kVessel_mm = kHeadCentre + Eigen::Vector3d(-8, 26, 40); // near the path
constexpr double kVesselRadius_mm = 9.0;

// The head about kHeadCentre, in an image whose header places it by T_image_planning.
casefile::Volume head_image(const Eigen::Matrix4d &T_image_planning, bool other) {
  const Eigen::Matrix4d back = T_image_planning.inverse();
  casefile::Volume out;
  out.size = {48, 54, 54};
  const Eigen::Vector3d centre = (T_image_planning * kHeadCentre.homogeneous()).head<3>();
  for (int d = 0; d < 3; ++d) {
    out.T_image_index(d, d) = kSpacing_mm;
    out.T_image_index(d, 3) = centre[d] - 0.5 * kSpacing_mm * (out.size[static_cast<std::size_t>(d)] - 1);
  }
  for (std::size_t i = 0; i < out.pixels(); ++i) {
    const Eigen::Vector3d p = (back * out.pixel_mm(i).homogeneous()).head<3>();
    const float grey = phantom_grey((p - kHeadCentre) / kScale);
    out.voxels.push_back(other ? 90.0F * std::sin(grey / 45.0F) + static_cast<float>(i % 7) : grey);
  }
  return out;
}

Eigen::Vector3d in_t2(const Eigen::Vector3d &planning_mm) {
  return (kT2FromPlanning * planning_mm.homogeneous()).head<3>();
}

TEST(SecondImage, ATargetPlannedInItIsNavigatedWithTheErrorOfItsRegistration) {
  Operation operation([](casefile::Case &a_case) {
    std::filesystem::remove(a_case.image);
    ASSERT_TRUE(casefile::write_volume(a_case.image, head_image(Eigen::Matrix4d::Identity(), false)));
  });
  const std::string folder = operation.case_folder().loaded().folder.string();
  const TemporaryFolder files;
  const auto run = [&](const std::string &words) {
    auto outcome = tests::run_bregma(files, words);
    EXPECT_EQ(outcome.exit_code, 0) << words << ": " << outcome.err << outcome.out;
    return outcome;
  };
  casefile::Volume vessel = head_image(kT2FromPlanning, true);
  ASSERT_TRUE(casefile::write_volume(files.path() / "t2.nii.gz", vessel));
  for (std::size_t i = 0; i < vessel.voxels.size(); ++i) {
    vessel.voxels[i] = (vessel.pixel_mm(i) - in_t2(kVessel_mm)).norm() < kVesselRadius_mm ? 1.0F : 0.0F;
  }
  ASSERT_TRUE(casefile::write_volume(files.path() / "vessel.nii.gz", vessel));
  const std::vector<casefile::NamedPoint> targets{{"Cyst", in_t2(kCyst_mm)}};
  const std::vector<casefile::Trajectory> paths{{"Cyst path", in_t2(kEntry_mm), in_t2(kCyst_mm)}};
  ASSERT_TRUE(casefile::write_points(files.path() / "cyst.mrk.json", "targets", targets));
  ASSERT_TRUE(casefile::write_trajectories(files.path() / "path.mrk.json", paths));
  run("image register t2.nii.gz '" + folder + "/image.nii.gz' --finest-mm 4 --result t2.json");
  run("image add '" + folder +
      "' t2.nii.gz --result t2.json --name T2 --targets cyst.mrk.json --trajectories "
      "path.mrk.json --labels vessel.nii.gz --structure Vessel=1");

  operation.case_folder().reload();
  const casefile::Case &a_case = operation.case_folder().loaded();
  const casefile::NamedPoint &cyst = a_case.targets.back();
  ASSERT_EQ(cyst.name + " " + cyst.placed_in, "Cyst T2");
  const Eigen::Vector3d error = cyst.position_mm - kCyst_mm;
  EXPECT_LT(error.norm(), 0.6);
  const double image_rms_mm = uncertainty::rms_mm(cyst.placing_covariance_mm2);
  EXPECT_GT(image_rms_mm, 0.02);
  EXPECT_LT(uncertainty::mahalanobis_squared(cyst.placing_covariance_mm2, error), 16.3) << "99.9 %";

  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  operation.start_daemon();
  std::string steps = kNavigateSteps;
  for (std::size_t at = steps.find("Biopsy"); at != std::string::npos; at = steps.find("Biopsy", at)) {
    steps.replace(at, 6, "Cyst path");
  }
  const std::string held = "duration_s = 60.0";
  steps.replace(steps.find(held), held.size(), "speed_mm_s = 25.0\n" + held);
  operation.start_room(steps);
  ASSERT_TRUE(operation.observe_until(
      [&] {
        return operation.probe_is(bregma_wire_POSE_LIVE) && operation.probe.back().distance_to_target_mm < 30.0 &&
               operation.accuracy.target_count == 2;
      },
      120.0))
      << operation.logs();

  const wire::NavigationState &state = operation.probe.back();
  EXPECT_EQ(wire::view(state.trajectory), "Cyst path");
  const Eigen::Vector3d tip = Eigen::Vector3d::Map(state.T_image_tip.translation_mm);
  EXPECT_NEAR(state.distance_to_target_mm, (tip - cyst.position_mm).norm(), 1e-6);
  EXPECT_LT(state.lateral_deviation_mm, 5.0) << "the operator follows the path that was planned in the second image";
  EXPECT_EQ(wire::view(state.nearest_structure), "Vessel") << "segmented in the second image";
  EXPECT_NEAR(state.nearest_structure_mm, std::max((tip - kVessel_mm).norm() - kVesselRadius_mm, 0.0), 2.5);
  const wire::TargetAccuracy &deep = operation.accuracy.targets[0];
  const wire::TargetAccuracy &target = operation.accuracy.targets[1];
  EXPECT_EQ(wire::view(target.target), "Cyst");
  EXPECT_NEAR(target.image_rms_mm, image_rms_mm, 1e-6);
  EXPECT_EQ(deep.image_rms_mm, 0.0);
  const auto &pose = operation.registration.accepted_covariance;
  const Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> of_patient(pose);
  const double patient_rms_mm = uncertainty::rms_mm(uncertainty::tre_covariance(of_patient, cyst.position_mm));
  EXPECT_NEAR(target.tre_rms_mm, std::hypot(patient_rms_mm, image_rms_mm), 1e-6) << "both errors are in the TRE";

  const auto status =
      tests::run_bregma(files, "status --images --json --wait 30 --domain " + std::to_string(operation.domain()));
  ASSERT_EQ(status.exit_code, 0) << status.err;
  EXPECT_NEAR(status.json()["accuracy"]["targets"][1]["image_rms_mm"].get<double>(), image_rms_mm, 1e-6);
  const auto json = status.json();
  for (const auto &second : json["tips_in_images"]) {
    EXPECT_EQ(second["image"], "T2");
    for (const auto &tool : json["tools"]) {
      if (tool["tool"] == second["tool"]) {
        const auto in_image = tool["tip_mm"].get<std::vector<double>>();
        const auto in_second = second["tip_mm"].get<std::vector<double>>();
        const Eigen::Vector3d truth = in_t2(Eigen::Vector3d::Map(in_image.data()));
        EXPECT_LT((Eigen::Vector3d::Map(in_second.data()) - truth).norm(), 0.6);
        EXPECT_GT(second["rms_mm"].get<double>(), tool["tre_rms_mm"].get<double>());
      }
    }
  }
  EXPECT_GE(json["tips_in_images"].size(), 1U) << status.out;
}

} // namespace
} // namespace bregma::test
