// Transforms in ITK's text format (.tfm, "#Insight Transform File V1.0"), which Slicer, ANTs and elastix read, and in
// ITK's binary format (.mat, MATLAB level 4), which ANTs writes.
//
// In memory: maps points of the source (moving) into the target (fixed), RAS, mm. In the file: LPS, in resampling
// direction, from a point of the fixed image to that of the moving one, which is the inverse. Reader and writer are our
// own, since the formats are short and the rest of casefile needs no ITK. The tests compare them with ITK's. Errors
// name the file, the line and the value.
#pragma once

#include <filesystem>

#include <Eigen/Core>

#include "algorithms/geometry/rigid3.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

using TargetFromSource = geometry::Rigid3<geometry::frame::Target, geometry::frame::Source>;

// Written as AffineTransform_double_3_3, which Slicer shows as a matrix, centre at the origin. The matrix must be
// affine (last row 0 0 0 1) and invertible.
[[nodiscard]] base::Result<void> write_itk_transform(const std::filesystem::path &file,
                                                     const Eigen::Matrix4d &T_target_source);

// One affine (AffineTransform, MatrixOffsetTransformBase, Similarity3DTransform) or rigid transform (Rigid3DTransform,
// Euler3DTransform, VersorRigid3DTransform, VersorTransform, QuaternionRigidTransform, TranslationTransform) of three
// dimensions, in double or float, also as the only one of a CompositeTransform. The content decides between text and
// binary, not the extension. Refused: others, several, a binary file that is not whole, a matrix that cannot be
// inverted.
[[nodiscard]] base::Result<Eigen::Matrix4d> read_itk_transform(const std::filesystem::path &file);

// The same, refused where it is not rigid to kRigidTolerance.
inline constexpr double kRigidTolerance = 1e-4;
[[nodiscard]] base::Result<TargetFromSource> read_itk_rigid(const std::filesystem::path &file);

} // namespace bregma::casefile
