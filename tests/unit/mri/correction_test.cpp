// The field on a grid, and slices corrected by it: a pattern whose distorted image is known in closed form.
#include <cmath>
#include <cstdint>
#include <random>
#include <span>
#include <stdexcept>
#include <vector>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "algorithms/mri/correction.hpp"
#include "tests/unit/mri/field_phantom.hpp"

namespace {

using namespace bregma;
using namespace bregma::mri;
using Eigen::Vector3d;

struct Scanner {
  test::SourceField truth{11, 2.5};
  DistortionField field;
  FieldTable table;
};
const Scanner &scanner() {
  static const Scanner out = [] {
    const test::SourceField truth(11, 2.5);
    const geometry::Points3 points = test::lattice(10, 20.0);
    DistortionField field = *DistortionField::fit(points, truth.image_of(points));
    FieldTable table(field, 4.0, 24.0, 2);
    return Scanner{truth, std::move(field), std::move(table)};
  }();
  return out;
}

double pattern(const Vector3d &p) {
  return 500.0 + 100.0 * (std::sin(p.x() / 7.0) + std::sin(p.y() / 6.0 + 1.0) + std::sin(p.z() / 8.0 + 2.0));
}

// Where the tissue is that the scanner shows at a place.
Vector3d true_place(const Vector3d &shown) {
  Vector3d p = shown;
  for (int i = 0; i < 15; ++i) {
    p = shown - scanner().truth.displacement(p);
  }
  return p;
}
double volume_ratio(const Vector3d &p) {
  Eigen::Matrix3d J;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d away = 0.01 * Vector3d::Unit(axis);
    J.col(axis) = (scanner().truth.image_of(Vector3d(p + away)) - scanner().truth.image_of(Vector3d(p - away))) / 0.02;
  }
  return J.determinant();
}

// A coronal stack of the distorted pattern, 1.5 mm apart around y = 40.
struct Stack {
  PlaneGeometry plane; // of the slice `middle`
  std::vector<std::vector<float>> slices;
  int middle = 6;
  [[nodiscard]] std::vector<std::span<const float>> views() const { return {slices.begin(), slices.end()}; }
  [[nodiscard]] Vector3d place(int column, int row, int slice) const {
    return (plane.T_field_index * Eigen::Vector4d(column, row, slice - middle, 1.0)).head<3>();
  }
};
Stack acquire(bool bright) {
  Stack out;
  out.plane.columns = 128;
  out.plane.rows = 120;
  out.plane.T_field_index << 1.2, 0.0, 0.0, -76.0, 0.0, 0.0, 1.5, 40.0, 0.0, -1.2, 0.0, 72.0, 0.0, 0.0, 0.0, 1.0;
  for (int k = 0; k < 13; ++k) {
    auto &slice = out.slices.emplace_back();
    for (int row = 0; row < out.plane.rows; ++row) {
      for (int column = 0; column < out.plane.columns; ++column) {
        const Vector3d p = true_place(out.place(column, row, k));
        slice.push_back(static_cast<float>(pattern(p) / (bright ? volume_ratio(p) : 1.0)));
      }
    }
  }
  return out;
}

double rms_error(const Stack &stack, const std::vector<float> &image) {
  double sum = 0.0;
  int count = 0;
  for (int row = 8; row + 8 < stack.plane.rows; ++row) {
    for (int column = 8; column + 8 < stack.plane.columns; ++column) {
      const auto at = static_cast<std::size_t>(row) * static_cast<std::size_t>(stack.plane.columns) +
                      static_cast<std::size_t>(column);
      sum += std::pow(static_cast<double>(image[at]) - pattern(stack.place(column, row, stack.middle)), 2);
      ++count;
    }
  }
  return std::sqrt(sum / count);
}

TEST(FieldTable, AgreesWithTheFieldAndItsInverseUndoesIt) {
  const Scanner &s = scanner();
  EXPECT_LT(s.table.table_error_mm(), 0.08);
  std::mt19937 rng(2);
  std::uniform_real_distribution<double> side(-85.0, 85.0);
  for (int i = 0; i < 500; ++i) {
    const Vector3d p(side(rng), side(rng), side(rng));
    const auto sample = s.table.sample(p);
    EXPECT_LT((s.field.to_imaged(p) - p - sample.displacement_mm).norm(), 0.05);
    EXPECT_EQ(sample.coverage, Coverage::kInterpolates);
    EXPECT_NEAR(s.table.volume_ratio(p), volume_ratio(p), 0.02);
    const auto back = s.table.to_true(s.table.to_imaged(p));
    ASSERT_TRUE(back);
    EXPECT_LT((*back - p).norm(), 1e-3);
  }
  EXPECT_EQ(s.table.sample({105.0, 0.0, 0.0}).coverage, Coverage::kExtrapolates);
  EXPECT_EQ(s.table.sample({500.0, 0.0, 0.0}).coverage, Coverage::kUnknown);
  const FieldTable again(s.table.displacements(), s.table.signed_errors(), s.table.max_error_95_mm());
  EXPECT_EQ(again.displacement({12.0, 3.0, 4.0}), s.table.displacement({12.0, 3.0, 4.0}));
}

TEST(PlaneCorrection, RestoresThePatternWithNeighboursAndLessWithoutThem) {
  const Stack stack = acquire(false);
  const auto views = stack.views();
  const PlaneCorrection correction(scanner().table, stack.plane);
  std::vector<float> corrected(stack.slices[6].size()), flat(corrected.size());
  correction.apply<float>(views, stack.middle, corrected);
  const std::span<const float> alone[] = {views[6]};
  correction.apply<float>(alone, 0, flat);
  const double before = rms_error(stack, stack.slices[6]);
  EXPECT_GT(before, 8.0);
  EXPECT_LT(rms_error(stack, corrected), 2.0);
  EXPECT_GT(rms_error(stack, flat), 2.0 * rms_error(stack, corrected));
  EXPECT_LT(rms_error(stack, flat), before);
  EXPECT_EQ(correction.missing_fraction(13, 6), 0.0);
  EXPECT_GT(correction.missing_fraction(1, 0), 0.1);
  EXPECT_GT(correction.summary().max_shift_mm, 1.0);
  EXPECT_GT(correction.summary().max_through_plane_mm, 0.3);
  EXPECT_LE(correction.summary().max_through_plane_mm, correction.summary().max_shift_mm);
  EXPECT_EQ(correction.summary().unknown_fraction, 0.0);
}

TEST(PlaneCorrection, RestoresTheBrightnessWhereAsked) {
  const Stack stack = acquire(true);
  const auto views = stack.views();
  std::vector<float> with(stack.slices[6].size()), without(with.size());
  PlaneCorrection(scanner().table, stack.plane, true).apply<float>(views, stack.middle, with);
  PlaneCorrection(scanner().table, stack.plane, false).apply<float>(views, stack.middle, without);
  EXPECT_LT(rms_error(stack, with), 4.0);
  EXPECT_GT(rms_error(stack, without), 2.0 * rms_error(stack, with));
}

TEST(PlaneCorrection, KeepsIntegersInRangeAndEmptiesWhatLiesOutside) {
  PlaneGeometry plane;
  plane.columns = 4;
  plane.rows = 3;
  plane.T_field_index.topRightCorner<3, 1>() = Vector3d(98.0, 0.0, 0.0);
  plane.T_field_index.topLeftCorner<3, 3>() *= 2.0;
  const std::vector<std::uint16_t> white(12, 65535);
  const std::span<const std::uint16_t> slices[] = {white};
  std::vector<std::uint16_t> out(12, 7);
  const PlaneCorrection correction(scanner().table, plane, true);
  correction.apply<std::uint16_t>(slices, 0, out);
  for (const std::uint16_t v : out) {
    EXPECT_TRUE(v == 0 || v > 50000) << v;
  }
  plane.columns = 1;
  EXPECT_THROW(PlaneCorrection(scanner().table, plane), std::invalid_argument);
}

} // namespace
