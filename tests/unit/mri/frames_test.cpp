// Frames of the scanner: headers of each orientation, typed composition, the printed orientation of planes.
#include <array>
#include <cmath>
#include <concepts>
#include <limits>
#include <random>
#include <type_traits>

#include <gtest/gtest.h>

#include "algorithms/mri/frames.hpp"

namespace {

using namespace bregma;
using namespace bregma::mri;

template <class A, class B>
concept Composes = requires(const A &a, const B &b) {
  a *b;
};
using DevicePatient = Rigid3<mri::frame::Device, mri::frame::Patient>;
using PatientGradient = Rigid3<mri::frame::Patient, mri::frame::Gradient>;
using GradientSlice = Rigid3<mri::frame::Gradient, mri::frame::Slice>;
using BaseDevice = Rigid3<mri::frame::Base, mri::frame::Device>;
static_assert(Composes<DevicePatient, PatientGradient> && Composes<PatientGradient, GradientSlice>);
static_assert(!Composes<DevicePatient, GradientSlice> && !Composes<PatientGradient, DevicePatient>);
static_assert(!Composes<BaseDevice, PatientGradient>);
static_assert(!std::is_convertible_v<DevicePatient, BaseDevice>);

SliceHeader header(const Vector3d &row, const Vector3d &column) {
  SliceHeader out;
  out.position_mm = {-30.0, 20.0, 7.0};
  out.along_row = row;
  out.along_column = column;
  out.row_spacing_mm = 2.0;
  out.column_spacing_mm = 1.5;
  out.rows = 101;
  out.columns = 201;
  return out;
}

// The formula of DICOM PS3.3, C.7.6.2.1.1, for pixel (column, row).
Vector3d dicom_position(const SliceHeader &h, double column, double row) {
  return h.position_mm + h.along_row * (h.column_spacing_mm * column) + h.along_column * (h.row_spacing_mm * row);
}

TEST(Frames, PixelsLieWhereDicomPlacesThemInEveryOrientation) {
  const Vector3d oblique = *parse_orientation("T>C38.3>S10.0");
  const PlaneDirections turned = plane_directions(oblique);
  for (const auto &[row, column, orientation] :
       {std::tuple(Vector3d(1, 0, 0), Vector3d(0, 1, 0), Orientation::kTransverse),
        std::tuple(Vector3d(1, 0, 0), Vector3d(0, 0, -1), Orientation::kCoronal),
        std::tuple(Vector3d(0, 1, 0), Vector3d(0, 0, -1), Orientation::kSagittal),
        std::tuple(turned.along_row, turned.along_column, Orientation::kDoubleOblique)}) {
    for (const EncodingDirection read : {EncodingDirection::kRowPositive, EncodingDirection::kRowNegative,
                                         EncodingDirection::kColumnPositive, EncodingDirection::kColumnNegative}) {
      SliceHeader h = header(row, column);
      h.read_out = read;
      const auto plane = SlicePlane::from(h);
      ASSERT_TRUE(plane) << plane.error();
      EXPECT_EQ(orientation_of(plane->normal()), orientation);
      EXPECT_LT((plane->T_patient_slice() * plane->pixel_mm(12.0, 34.5) - dicom_position(h, 12.0, 34.5)).norm(), 1e-9);
      // The origin of Gradient is the middle of the field of view, its x axis the read-out.
      EXPECT_LT((plane->T_gradient_slice() * plane->pixel_mm(100.0, 50.0)).norm(), 1e-9);
      EXPECT_LT((plane->T_gradient_slice().rotation() * direction_in_slice(read) - Vector3d::UnitX()).norm(), 1e-9);
      EXPECT_NEAR((plane->T_gradient_slice().rotation() * Vector3d::UnitZ()).z(), 1.0, 1e-9);
    }
  }
}

TEST(Frames, OnlyTheGradientFrameMovesFromSliceToSlice) {
  SliceHeader h = header({1, 0, 0}, {0, 0, -1});
  const auto first = SlicePlane::from(h);
  h.position_mm += 1.5 * first->normal();
  const auto second = SlicePlane::from(h);
  EXPECT_LT((first->T_gradient_slice().matrix() - second->T_gradient_slice().matrix()).norm(), 1e-12);
  const Vector3d step = second->T_patient_gradient().translation() - first->T_patient_gradient().translation();
  EXPECT_LT((step - 1.5 * first->normal()).norm(), 1e-12);
  // [Tuna 2022, (12)]: with T_base_device fixed, the transform of (11) is another one for each slice.
  const BaseDevice T_base_device(geometry::rotation_exp({0.1, 0.2, 0.3}), Vector3d(5, 6, 7));
  const auto T_base_first = T_base_device * first->T_device_slice();
  const auto T_base_second = T_base_device * second->T_device_slice();
  EXPECT_NEAR((T_base_first.translation() - T_base_second.translation()).norm(), 1.5, 1e-12);
}

TEST(Frames, PatientPositionsAreRightHandedAndPlaceHeadAndFace) {
  const Vector3d left(1, 0, 0), posterior(0, 1, 0), superior(0, 0, 1), up(0, 1, 0), right(1, 0, 0), out(0, 0, 1);
  const auto device = [](PatientPosition p, const Vector3d &v) { return Vector3d(T_device_patient(p) * v); };
  for (const PatientPosition p :
       {PatientPosition::kHfs, PatientPosition::kHfp, PatientPosition::kHfdr, PatientPosition::kHfdl,
        PatientPosition::kFfs, PatientPosition::kFfp, PatientPosition::kFfdr, PatientPosition::kFfdl}) {
    const std::string label = name(p);
    ASSERT_EQ(parse_patient_position(label), p);
    EXPECT_NEAR(T_device_patient(p).rotation_matrix().determinant(), 1.0, 1e-12) << label;
    // With the head first, the head points into the bore.
    EXPECT_LT((device(p, superior) - (label[0] == 'H' ? Vector3d(-out) : out)).norm(), 1e-12) << label;
    const std::string side = label.substr(2);
    const Vector3d lowest = side == "S"    ? posterior
                            : side == "P"  ? Vector3d(-posterior)
                            : side == "DL" ? left
                                           : Vector3d(-left);
    EXPECT_LT((device(p, lowest) + up).norm(), 1e-12) << label;
  }
  EXPECT_LT((device(PatientPosition::kHfs, left) - right).norm(), 1e-12);
  const auto refused = parse_patient_position("HFX");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error(), "patient position 'HFX' is none of HFS, HFP, HFDR, HFDL, FFS, FFP, FFDR, FFDL");
  EXPECT_EQ(parse_patient_position("HFS "), PatientPosition::kHfs);
  EXPECT_LT((T_image_patient() * Vector3d(1, 2, 3) - Vector3d(-1, -2, 3)).norm(), 1e-12);
}

TEST(Frames, HeadersThatDescribeNoPlaneAreRefusedByField) {
  const auto message = [](auto change) {
    SliceHeader h = header({1, 0, 0}, {0, 1, 0});
    change(h);
    const auto plane = SlicePlane::from(h);
    return plane ? std::string("accepted") : plane.error();
  };
  EXPECT_EQ(message([](SliceHeader &) {}), "accepted");
  EXPECT_EQ(message([](SliceHeader &h) {
              h.along_row = {0.9, 0, 0};
            }),
            "ImageOrientationPatient: the direction of a row (0.9, 0, 0) is not of unit length");
  EXPECT_EQ(message([](SliceHeader &h) {
              h.along_column = {0.6, 0.8, 0};
            }),
            "ImageOrientationPatient: row (1, 0, 0) and column (0.6, 0.8, 0) are not perpendicular");
  EXPECT_EQ(message([](SliceHeader &h) { h.column_spacing_mm = 0.0; }),
            "PixelSpacing: the second value 0.000000 is not positive");
  EXPECT_EQ(message([](SliceHeader &h) { h.rows = 0; }), "Rows 0 or Columns 201 is not positive");
  EXPECT_EQ(message([](SliceHeader &h) { h.thickness_mm = -1.0; }),
            "SliceThickness -1.000000 is negative or not finite");
  EXPECT_EQ(message([](SliceHeader &h) { h.position_mm.x() = std::numeric_limits<double>::quiet_NaN(); }),
            "ImagePositionPatient (nan, 20, 7) is not finite");
  EXPECT_EQ(message([](SliceHeader &h) { h.along_row.x() = std::numeric_limits<double>::infinity(); }),
            "ImageOrientationPatient: the direction of a row (inf, 0, 0) is not of unit length");
}

TEST(Orientation, ThePapersDoubleObliqueIsParsedAndPrinted) {
  const auto normal = parse_orientation("T>C38.3>S10.0");
  ASSERT_TRUE(normal) << normal.error();
  const double a = 38.3 * M_PI / 180.0, b = 10.0 * M_PI / 180.0;
  EXPECT_LT((*normal - Vector3d(std::sin(b), std::cos(b) * std::sin(a), std::cos(b) * std::cos(a))).norm(), 1e-12);
  EXPECT_EQ(print_orientation(*normal), "T>C38.3>S10.0");
  EXPECT_EQ(print_orientation(-*normal), "T>C38.3>S10.0");
  EXPECT_STREQ(name(orientation_of(*normal)), "double oblique");
}

TEST(Orientation, PrintedTextIsParsedBackForAnyNormal) {
  std::mt19937 rng(20261129);
  std::normal_distribution<double> gauss;
  for (int i = 0; i < 2000; ++i) {
    const Vector3d normal = Vector3d::NullaryExpr([&] { return gauss(rng); }).normalized();
    const std::string text = print_orientation(normal);
    const auto back = parse_orientation(text);
    ASSERT_TRUE(back) << back.error();
    EXPECT_GT(std::abs(back->dot(normal)), std::cos(0.0015)) << text; // 0.05 degrees in each angle
    const PlaneDirections directions = plane_directions(normal);
    EXPECT_NEAR(directions.along_row.dot(directions.along_column), 0.0, 1e-12);
    EXPECT_NEAR(std::abs(directions.along_row.cross(directions.along_column).dot(normal)), 1.0, 1e-12);
  }
  EXPECT_EQ(print_orientation({0, 1, 0}), "C");
  EXPECT_EQ(print_orientation({0, 0, -1}), "T");
  EXPECT_EQ(print_orientation(*parse_orientation("Sag > Tra -12.5")), "S>T-12.5");
}

TEST(Orientation, AnglesTiltTowardsTheNamedAxis) {
  EXPECT_GT(parse_orientation("T>C20")->y(), 0.3);
  EXPECT_LT(parse_orientation("T>C-20")->y(), -0.3);
  EXPECT_GT(parse_orientation("C>S+20")->x(), 0.3);
}

TEST(Orientation, TextsThatAreNoneAreRefusedByTheirPart) {
  const auto message = [](std::string_view text) {
    const auto normal = parse_orientation(text);
    return normal ? std::string("accepted") : normal.error();
  };
  EXPECT_EQ(message("X>C38.3"), "orientation 'X>C38.3': expected S, C or T, found 'X>C38.3'");
  EXPECT_EQ(message(""), "orientation '': expected S, C or T, found ''");
  EXPECT_EQ(message("T>T10"), "orientation 'T>T10': an axis is repeated");
  EXPECT_EQ(message("T>C"), "orientation 'T>C': expected an angle of at most 90 degrees, found ''");
  EXPECT_EQ(message("T>C91"), "orientation 'T>C91': expected an angle of at most 90 degrees, found '91'");
  EXPECT_EQ(message("T>Cnan"), "orientation 'T>Cnan': expected an angle of at most 90 degrees, found 'nan'");
  EXPECT_EQ(message("T>C1>S2>T3"), "orientation 'T>C1>S2>T3': expected '>' and at most two tilts, found '>T3'");
  EXPECT_EQ(message("T38.3"), "orientation 'T38.3': expected '>' and at most two tilts, found '38.3'");
}

} // namespace
