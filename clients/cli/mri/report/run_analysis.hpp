// The figures of one registration of a scanner, from what was received: distortion of the phantom, coils, and where the
// truth is known the errors. All positions in the frame Device. Pure; seconds.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "algorithms/geometry/points.hpp"
#include "algorithms/mri/coil_frame.hpp"
#include "algorithms/mri/coils/artefacts.hpp"
#include "algorithms/mri/distortion_field.hpp"
#include "algorithms/mri/frames.hpp"
#include "algorithms/mri/grid/slice_crossings.hpp"
#include "clients/cli/mri/report/run_record.hpp"

namespace bregma::cli::mri_report {

using mri::Rigid3;
using mri::Vector3d;

struct RunInputs {
  mri::CoilFrame frame;
  geometry::Points3 phantom_mm; // control points in CT, RAS; empty: the phantom is not drawn
  double cell_mm = 15.0, bar_mm = 2.0;
  Vector3d target_mm = Vector3d::Zero(); // in Base
  // Known only to a simulation.
  std::optional<Rigid3<mri::frame::Device, mri::frame::Base>> T_device_base;
};

// One plane of the phantom's crossings (figure 11).
struct PhantomPlane {
  double at_mm = 0.0; // mean along the slices' normal
  mri::ErrorSummary distortion;
  std::vector<Eigen::Index> points; // columns of PhantomAnalysis::true_mm
};

struct PhantomAnalysis {
  // Unit vectors of the slices: along a row, a column, and their normal.
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  geometry::Points3 true_mm, imaged_mm;      // column i of both is the same crossing
  std::optional<mri::DistortionField> field; // true to imaged
  mri::ErrorSummary before, after;           // table 3; after: at the points held out
  std::vector<PhantomPlane> planes;          // by position
  std::size_t unmatched = 0;
  // The steps of figure 3 in the slice with most crossings of one plane.
  std::vector<mri::CrossingStage> stages;
  std::vector<Eigen::Vector2d> crossings; // in the first stage's pixels
  double slice_mm = 0.0;                  // along the normal
};

// A pair of stacks (figures 6 and 7).
struct CoilAnalysis {
  std::string protocol;
  Stack background, foreground;
  mri::ArtefactSearch search;
};

struct RunAnalysis {
  std::optional<PhantomAnalysis> phantom;
  std::string phantom_missing; // why there is none
  std::vector<CoilAnalysis> coils;
  // NaN where it is not known.
  double target_error_mm = 0.0; // true error of the accepted registration at the target
  double predicted_95_mm = 0.0; // of the accepted registration
  double tip_error_mm = 0.0;    // of the tip as it was published in the scanner
  double tip_predicted_95_mm = 0.0;
};

[[nodiscard]] RunAnalysis analyse(const RunRecord &record, const RunInputs &inputs);

} // namespace bregma::cli::mri_report
