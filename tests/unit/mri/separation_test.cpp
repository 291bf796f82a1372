// Gradients and B0 from several scans: fields that share no formula with the estimator, and the real phantom's repeats.
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/mri/point_matching.hpp"
#include "algorithms/mri/scan_fields.hpp"
#include "algorithms/mri/separation.hpp"
#include "tests/unit/mri/field_phantom.hpp"

namespace {

using namespace bregma;
using namespace bregma::mri;
using Eigen::Index;
using Eigen::Vector3d;
using geometry::Points3;

const test::SourceField kGradients(31, 2.0), kB0(32, 25.0); // mm; Hz as the first coordinate
double b0_Hz(const Vector3d &p) { return kB0.displacement(p).x(); }

PhantomScan scan_of(const Points3 &points, const Vector3d &mm_per_Hz, unsigned seed, double noise_mm = 0.05) {
  PhantomScan out{points, mm_per_Hz};
  for (Index i = 0; i < points.cols(); ++i) {
    const Vector3d p = points.col(i);
    out.imaged_mm.col(i) = kGradients.image_of(p) + b0_Hz(p) * mm_per_Hz;
  }
  out.imaged_mm = test::with_noise(out.imaged_mm, noise_mm, seed);
  return out;
}

// Mean errors at other points than those of the fit.
struct Errors {
  double gradients_mm = 0.0, b0_Hz = 0.0;
};
Errors errors_of(const SeparatedField &field) {
  const Points3 probes = test::lattice(5, 29.0, {2.0, -3.0, 1.0});
  Errors out;
  for (const auto &p : probes.colwise()) {
    out.gradients_mm += (field.gradients.to_imaged(p) - kGradients.image_of(Vector3d(p))).norm();
    out.b0_Hz += std::abs(field.b0_Hz(p) - b0_Hz(p));
  }
  out.gradients_mm /= static_cast<double>(probes.cols());
  out.b0_Hz /= static_cast<double>(probes.cols());
  return out;
}

TEST(Separation, OpposedReadOutsSeparateGradientsAndB0) {
  const Points3 points = test::lattice(7, 24.0);
  const Vector3d d = b0_movement(Vector3d::UnitX(), 1.0, 26.0); // a low bandwidth: 1 mm per 26 Hz
  EXPECT_NEAR(d.x(), 1.0 / 26.0, 1e-12);
  const std::vector<PhantomScan> scans{scan_of(points, d, 1), scan_of(points, -d, 2)};
  const auto field = separate_fields(points, scans);
  ASSERT_TRUE(field.has_value()) << field.error();
  const Errors errors = errors_of(*field);
  EXPECT_LT(errors.gradients_mm, 0.06);
  EXPECT_LT(errors.b0_Hz, 1.0);
  // One scan takes B0 for a part of the gradients.
  const auto one = DistortionField::fit(points, scans[0].imaged_mm);
  ASSERT_TRUE(one.has_value());
  const Points3 wrong = residuals(*one, points, scans[1].imaged_mm);
  const Points3 right = residuals(*field, points, scans[1]);
  EXPECT_GT(summarise(wrong).overall.mean_mm, 5.0 * summarise(right).overall.mean_mm);
}

TEST(Separation, ThreeOrientationsAreIteratedAndPredictAProtocolThatWasNotScanned) {
  const Points3 points = test::lattice(7, 24.0);
  std::vector<PhantomScan> scans;
  for (int axis = 0; axis < 3; ++axis) {
    scans.push_back(scan_of(points,
                            b0_movement(Vector3d::Unit(axis), 1.0, 26.0, Vector3d::Unit((axis + 1) % 3), 2.0, 150.0),
                            static_cast<unsigned>(axis)));
  }
  scans[1].imaged_mm.col(5).setConstant(std::numeric_limits<double>::quiet_NaN()); // a point that one does not show
  const auto field = separate_fields(points, scans);
  ASSERT_TRUE(field.has_value()) << field.error();
  EXPECT_GT(field->iterations, 2);
  EXPECT_LE(field->last_change_mm, SeparationOptions{}.tolerance_mm);
  const Errors errors = errors_of(*field);
  EXPECT_LT(errors.gradients_mm, 0.06);
  EXPECT_LT(errors.b0_Hz, 1.0);
  // Half the pixel at twice the bandwidth moves a quarter as far.
  const PhantomScan other = scan_of(points, b0_movement(-Vector3d::UnitZ(), 0.5, 52.0), 9);
  EXPECT_LT(summarise(residuals(*field, points, other)).overall.mean_mm, 0.15);
}

// A second scan whose slices are 1 % farther apart than stated, on a table that lies 0.6 mm off.
TEST(Separation, WhatB0CannotDoBetweenTwoScansIsTakenOutWhereItIsAskedFor) {
  const Points3 points = test::lattice(7, 24.0);
  const Vector3d d = b0_movement(Vector3d::UnitX(), 1.0, 26.0);
  std::vector<PhantomScan> scans{scan_of(points, d, 1), scan_of(points, -d, 2)};
  scans[1].imaged_mm.row(2) += 0.01 * points.row(2);
  scans[1].imaged_mm.row(1).array() += 0.6;
  const auto relative = relative_placements(points, scans);
  ASSERT_EQ(relative.size(), 2U);
  EXPECT_TRUE(relative[0].shift_mm.isZero() && relative[0].slope.isZero());
  EXPECT_NEAR(relative[1].slope(2, 2), 0.01, 0.001);
  EXPECT_NEAR(relative[1].shift_mm.y(), 0.6, 0.05);
  EXPECT_NEAR(relative[1].shift_mm.x(), 0.0, 1e-9) << "along the read-out B0 may do anything";
  const auto mean_residual = [&](const std::vector<PhantomScan> &of) {
    const auto field = separate_fields(points, of);
    return field ? summarise(residuals(*field, points, of[1])).overall.mean_mm : 99.0;
  };
  const double before = mean_residual(scans);
  scans[1] = without(relative[1], points, scans[1]);
  EXPECT_LT(mean_residual(scans), 0.3 * before);
  // With d_s in all directions nothing can be told apart.
  const std::vector<PhantomScan> three{scan_of(points, Vector3d::UnitX() / 26.0, 1),
                                       scan_of(points, Vector3d::UnitY() / 26.0, 2),
                                       scan_of(points, Vector3d::UnitZ() / 26.0, 3)};
  EXPECT_TRUE(relative_placements(points, three)[2].slope.isZero());
}

// From two scans with opposed read-outs the field of a scan along another axis, with another bandwidth.
TEST(Separation, TheTableOfEveryReadOutFollowsFromBothParts) {
  const Points3 points = test::lattice(7, 24.0);
  const Vector3d d = b0_movement(Vector3d::UnitX(), 1.0, 26.0);
  const auto field = separate_fields(points, std::vector{scan_of(points, d, 1), scan_of(points, -d, 2)});
  ASSERT_TRUE(field.has_value()) << field.error();
  const ScanFields fields(*field, d);
  ASSERT_TRUE(fields.has_b0());
  for (const Vector3d &other : {d, Vector3d(-d), b0_movement(Vector3d::UnitZ(), 1.5, 20.0)}) {
    const auto table = fields.of_scan(other);
    double mean = 0.0;
    int covered = 0;
    const Points3 probes = test::lattice(5, 29.0, {2.0, -3.0, 1.0});
    for (const auto &probe : probes.colwise()) {
      const Vector3d p = probe;
      const double error = (table->to_imaged(p) - kGradients.image_of(p) - b0_Hz(p) * other).norm();
      mean += error / static_cast<double>(probes.cols());
      covered += error <= table->sample(p).error_95_mm ? 1 : 0;
      EXPECT_GT(table->sample(p).error_95_mm, fields.table()->sample(p).error_95_mm);
    }
    EXPECT_LT(mean, 0.08) << other.transpose();
    EXPECT_GE(covered, static_cast<int>(0.93 * static_cast<double>(probes.cols()))) << other.transpose();
  }
  const Vector3d p(20.0, -30.0, 10.0);
  EXPECT_NEAR(fields.b0_Hz(p), b0_Hz(p), 2.0);
  EXPECT_FALSE(fields.is_opposite(-d));
  // A field of one read-out is the same for all scans, but not for the opposite read-out.
  const ScanFields one(fields.of_scan(d), d);
  EXPECT_FALSE(one.has_b0());
  EXPECT_EQ(one.of_scan(-d), one.table());
  EXPECT_TRUE(one.is_opposite(-2.0 * d));
  EXPECT_FALSE(one.is_opposite(Vector3d::UnitZ()));
  EXPECT_FALSE(one.is_opposite(Vector3d::Zero())) << "not stated";
  // Parts of two fields are not put together.
  const auto coarser = std::make_shared<const FieldTable>(field->gradients, 5.0);
  EXPECT_THROW(ScanFields(fields.table(), coarser, d), std::invalid_argument);
  EXPECT_THROW(ScanFields(fields.table(), fields.by_b0(), Vector3d::Zero()), std::invalid_argument);
}

TEST(Separation, ScansThatB0MovesAlikeAreRefused) {
  const Points3 points = test::lattice(4, 24.0);
  const Vector3d d = b0_movement(Vector3d::UnitX(), 1.0, 260.0);
  const auto reason = [&](const std::vector<PhantomScan> &scans) {
    const auto field = separate_fields(points, scans);
    return field ? std::string("separated") : field.error();
  };
  EXPECT_NE(reason({scan_of(points, d, 1)}).find("one scan"), std::string::npos);
  EXPECT_NE(reason({scan_of(points, d, 1), scan_of(points, d, 2)}).find("alike"), std::string::npos);
  EXPECT_NE(reason({scan_of(points, d, 1), {Points3(points.leftCols(9)), -d}}).find("64 true points but 9"),
            std::string::npos);
}

} // namespace
