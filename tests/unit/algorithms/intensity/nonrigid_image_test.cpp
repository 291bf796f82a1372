// Nonrigid registration: a known smooth deformation is found without folds, and forces on samples are derivatives.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "algorithms/intensity/histogram_measure.hpp"
#include "algorithms/intensity/nonrigid_image.hpp"
#include "tests/unit/algorithms/intensity/phantom.hpp"

namespace bregma::intensity {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

// Up to 5 mm; no spline of the lattice.
Vector3d bulge(const Vector3d &p) {
  return 5.0 * std::exp(-(p - Vector3d(8, 4, 0)).squaredNorm() / 450.0) * Vector3d(0.6, -0.8, 0.0) +
         3.0 * std::exp(-(p - Vector3d(-10, -6, 5)).squaredNorm() / 300.0) * Vector3d(0.0, 0.3, 0.95);
}

// The body, bent: the point p + bulge(p) of this image shows what the phantom shows at p. Another modality.
Volume bent(std::array<int, 3> size) {
  Volume out = test::phantom(size, {1.8, 1.8, 1.8});
  for (std::size_t i = 0; i < out.pixels(); ++i) {
    const Vector3d q = out.pixel_mm(i);
    Vector3d p = q;
    for (int n = 0; n < 30; ++n) {
      p = q - bulge(p);
    }
    out.voxels[i] = 90.0F * std::sin(test::phantom_grey(p) / 45.0F);
  }
  return out;
}

TEST(NonrigidImage, FindsASmoothDeformationOfAnotherModality) {
  const Volume reference = test::phantom({38, 42, 36}, {1.8, 1.8, 1.8});
  const Volume floating = bent({38, 42, 36});
  NonrigidImageOptions options;
  options.finest_mm = 1.8;
  options.grid_mm = 14.0;
  options.bending = 20.0;
  options.max_iterations = 25;
  parallel::Team team(2);
  const NonrigidImageResult result = register_nonrigid(reference, floating, {}, options, team);
  EXPECT_TRUE(result.found) << result.reason;
  EXPECT_GT(result.similarity, result.similarity_before);
  EXPECT_GT(result.jacobian.smallest, 0.2);
  EXPECT_LT(result.jacobian.largest, 3.0);
  double before = 0.0;
  double after = 0.0;
  double count = 0.0;
  for (std::size_t i = 0; i < reference.pixels(); ++i) {
    if (reference.voxels[i] > 30.0F) {
      const Vector3d p = reference.pixel_mm(i);
      before += bulge(p).squaredNorm();
      after += (result.field.displacement_mm(p) - bulge(p)).squaredNorm();
      count += 1.0;
    }
  }
  EXPECT_GT(std::sqrt(before / count), 2.0);
  EXPECT_LT(std::sqrt(after / count), 0.9) << "half a voxel";
  // The number of threads changes nothing.
  options.max_iterations = 4;
  parallel::Team alone(1);
  EXPECT_EQ(register_nonrigid(reference, floating, {}, options, team).field.coefficients(),
            register_nonrigid(reference, floating, {}, options, alone).field.coefficients());
}

TEST(NonrigidImage, RefusesAFoldAndStopsWhenItsCallerWantsThat) {
  const Volume reference = test::phantom({30, 32, 28}, {2.2, 2.2, 2.2});
  Volume other = reference;
  for (std::size_t i = 0; i < other.pixels(); ++i) { // another body: nothing smooth leads there
    const Vector3d p = other.pixel_mm(i);
    other.voxels[i] = test::phantom_grey(Vector3d(p.y(), -p.x(), -p.z())) + static_cast<float>((i * 7919) % 23);
  }
  NonrigidImageOptions options;
  options.finest_mm = 2.2;
  options.grid_mm = 6.0;
  options.bending = 0.0;
  options.max_iterations = 15;
  parallel::Team team(2);
  const NonrigidImageResult folded = register_nonrigid(reference, other, {}, options, team);
  EXPECT_FALSE(folded.found);
  EXPECT_TRUE(folded.reason.starts_with("the deformation folds (smallest Jacobian -")) << folded.reason;
  options.progress = [](double, std::string_view) { return false; };
  EXPECT_EQ(register_nonrigid(reference, other, {}, options, team).reason, "stopped");
}

TEST(HistogramMeasure, ForcesOnMovedSamplesAreDerivatives) {
  const Volume reference = test::phantom({20, 22, 18}, {2.0, 2.0, 2.0});
  Volume floating = test::phantom({44, 40, 42}, {1.9, 2.1, 2.0});
  std::transform(floating.voxels.begin(), floating.voxels.end(), floating.voxels.begin(),
                 [](float v) { return 80.0F * std::sin(v / 40.0F); });
  parallel::Team team(2);
  const Matrix4d T = test::pose({4, -6, 5}, {2, 1.5, -1});
  for (const Measure m : {Measure::kMi, Measure::kNmi, Measure::kMfMi}) {
    MeasureOptions options;
    options.bins = 32;
    const auto measure = make_histogram_measure(m, reference, floating, options, team);
    const double still = measure->value(T);
    std::array<std::vector<float>, 3> force;
    for (auto &list : force) {
      list.resize(measure->sampler().padded());
    }
    auto &moved = measure->sampler().moved();
    EXPECT_EQ(measure->value_and_forces(T, {force[0].data(), force[1].data(), force[2].data()}), still);
    // Samples of one half move along the reference's first axis.
    const Eigen::Matrix3d to_index = floating.axes().inverse() * T.topLeftCorner<3, 3>() * reference.axes();
    double expected = 0.0;
    const std::size_t half = measure->samples() / 2;
    for (std::size_t i = 0; i < half; ++i) {
      for (std::size_t d = 0; d < 3; ++d) {
        expected += static_cast<double>(force[d][i]) * to_index(static_cast<Eigen::Index>(d), 0);
      }
    }
    const auto at = [&](float shift) {
      for (std::size_t i = 0; i < half; ++i) {
        moved[0][i] = measure->sampler().coordinate(0)[i] + shift;
      }
      return measure->value(T);
    };
    const double difference = (at(0.01F) - at(-0.01F)) / 0.02;
    EXPECT_NEAR(expected, difference, 0.03 * std::abs(difference)) << name_of(m);
  }
  EXPECT_THROW((void)make_histogram_measure(Measure::kRmi, reference, floating, {}, team), std::invalid_argument);
}

} // namespace
} // namespace bregma::intensity
