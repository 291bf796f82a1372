// The error of a path's clearance, compared with draws of the images' registration errors.
#include <cmath>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "case_model/path_clearance.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace {

using namespace bregma::case_model;
using namespace bregma::casefile;
using bregma::geometry::Matrix6d;
using bregma::geometry::Vector6d;
using Eigen::Vector3d;

// 0.5 degrees and 0.4 mm, with a correlation.
Matrix6d covariance(double scale) {
  Matrix6d root = Matrix6d::Zero();
  root.diagonal() << 0.009, 0.007, 0.008, 0.3, 0.25, 0.4;
  root(3, 1) = 0.1;
  return scale * root * root.transpose();
}

Case case_with_two_images() {
  Case c = bregma::tests::sample_case("somewhere");
  c.trajectories = {{"Biopsy", {5, 40, 80}, {10, -5, 20}}};
  for (const auto &[name, scale] : {std::pair("T2", 1.0), {"PET", 2.0}}) {
    RegisteredImage image;
    image.name = name;
    image.T_image_source.covariance = covariance(scale);
    c.images.push_back(image);
  }
  return c;
}

std::vector<PathClearance> clearances(const Case &c) {
  std::vector<bregma::planning::NamedMesh> meshes;
  for (const Surface &structure : c.structures) {
    meshes.push_back({structure.name, structure.mesh});
  }
  return path_clearances(c, bregma::planning::CriticalStructures(meshes), c.trajectories.front());
}

// Standard deviation of the nearest structure's distance over 400 draws of the errors of all images.
double drawn_sigma_mm(const Case &c) {
  std::mt19937 rng(20261129);
  std::normal_distribution<double> normal;
  double sum = 0.0;
  double squares = 0.0;
  constexpr int kDraws = 400;
  const std::string nearest = clearances(c).front().structure;
  for (int draw = 0; draw < kDraws; ++draw) {
    Case moved = c;
    for (const RegisteredImage &image : c.images) {
      Vector6d unit;
      for (double &value : unit) {
        value = normal(rng);
      }
      const Vector6d error = image.T_image_source.covariance.llt().matrixL() * unit;
      const Vector3d turn = error.head<3>();
      const auto move = [&](Vector3d &p) {
        p = Eigen::AngleAxisd(turn.norm(), turn.normalized()) * p + error.tail<3>();
      };
      Trajectory &path = moved.trajectories.front();
      if (path.entry_in == image.name) {
        move(path.entry_mm);
      }
      if (path.target_in == image.name) {
        move(path.target_mm);
      }
      for (Surface &structure : moved.structures) {
        if (structure.segmented_in == image.name) {
          std::for_each(structure.mesh.vertices_mm.begin(), structure.mesh.vertices_mm.end(), move);
        }
      }
    }
    for (const PathClearance &clearance : clearances(moved)) {
      if (clearance.structure == nearest) {
        sum += clearance.distance_mm;
        squares += clearance.distance_mm * clearance.distance_mm;
      }
    }
  }
  return std::sqrt(squares / kDraws - sum / kDraws * sum / kDraws);
}

TEST(PathClearance, ContainsTheErrorOfTheImagesOfThePathAndOfTheStructure) {
  Case c = case_with_two_images();
  EXPECT_EQ(clearances(c).front().structure, "Precentral R");
  EXPECT_EQ(clearances(c).front().image_sigma_mm, 0.0) << "all in the planning image";
  c.structures[1].segmented_in = "T2";
  const double of_structure = clearances(c).front().image_sigma_mm;
  EXPECT_GT(of_structure, 0.2);
  EXPECT_EQ(clearances(c).back().image_sigma_mm, 0.0) << "the other structure is of the planning image";
  EXPECT_NEAR(of_structure, drawn_sigma_mm(c), 0.1 * of_structure);

  c.trajectories.front().entry_in = c.trajectories.front().target_in = "PET";
  const double of_both = clearances(c).front().image_sigma_mm;
  EXPECT_GT(of_both, of_structure);
  EXPECT_NEAR(of_both, drawn_sigma_mm(c), 0.1 * of_both);

  c.trajectories.front().entry_in = "";
  const double of_one_end = clearances(c).front().image_sigma_mm;
  EXPECT_NEAR(of_one_end, drawn_sigma_mm(c), 0.1 * of_one_end);

  c.trajectories.front().entry_in = c.trajectories.front().target_in = "T2";
  EXPECT_LT(clearances(c).front().image_sigma_mm, 1e-3) << "both move alike";
}

} // namespace
