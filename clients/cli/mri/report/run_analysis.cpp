#include "clients/cli/mri/report/run_analysis.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include <Eigen/Geometry>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/mri/grid/grid_points.hpp"
#include "algorithms/mri/lattice.hpp"
#include "algorithms/mri/point_matching.hpp"
#include "base/result.hpp"
#include "idl/names.hpp"

namespace bregma::cli::mri_report {

namespace {

constexpr double kShownPlane_mm = 18.0; // as in figure 12 of the paper: figure 3 is drawn near it
constexpr int kTriedSlices = 3;         // on either side

mri::PatientPosition position_of(const wire::ImageSlice &slice) {
  const bool stated =
      slice.patient_position >= bregma_wire_POSITION_HFS && slice.patient_position <= bregma_wire_POSITION_FFDL;
  return stated ? static_cast<mri::PatientPosition>(slice.patient_position - bregma_wire_POSITION_HFS)
                : mri::PatientPosition::kHfs;
}

// Points in Device from those in Image (RAS), or the other way round by the inverse.
geometry::Points3 moved(const Eigen::Matrix4d &T, const geometry::Points3 &points) {
  return (T.topLeftCorner<3, 3>() * points).colwise() + T.topRightCorner<3, 1>();
}

// Groups of points of one plane of the lattice: whole steps along that step which is nearest to the normal.
std::vector<PhantomPlane> planes_of(const geometry::Points3 &true_mm, const geometry::Points3 &imaged_mm,
                                    const Vector3d &normal) {
  const mri::LatticeSteps lattice = mri::lattice_steps(true_mm);
  Vector3d step = Vector3d::Zero();
  for (Eigen::Index i = 0; i < lattice.steps_mm.cols(); ++i) {
    const Vector3d candidate = lattice.steps_mm.col(i);
    if (std::abs(candidate.normalized().dot(normal)) > std::abs(step.dot(normal)) / std::max(step.norm(), 1e-9)) {
      step = candidate;
    }
  }
  if (step.norm() < 1.0) {
    return {};
  }
  // Planes are perpendicular to the step in a cubic lattice; the first point decides the phase.
  std::map<long, PhantomPlane> groups;
  for (Eigen::Index i = 0; i < true_mm.cols(); ++i) {
    const Vector3d from_first = true_mm.col(i) - true_mm.col(0);
    groups[std::lround(from_first.dot(step) / step.squaredNorm())].points.push_back(i);
  }
  std::vector<PhantomPlane> out;
  for (auto &[number, plane] : groups) {
    geometry::Points3 errors(3, static_cast<Eigen::Index>(plane.points.size()));
    for (std::size_t i = 0; i < plane.points.size(); ++i) {
      const Eigen::Index at = plane.points[i];
      errors.col(static_cast<Eigen::Index>(i)) = imaged_mm.col(at) - true_mm.col(at);
      plane.at_mm += normal.dot(true_mm.col(at)) / static_cast<double>(plane.points.size());
    }
    plane.distortion = mri::summarise(errors);
    out.push_back(std::move(plane));
  }
  std::sort(out.begin(), out.end(), [](const PhantomPlane &a, const PhantomPlane &b) { return a.at_mm < b.at_mm; });
  return out;
}

// The steps of figure 3, in that slice near the plane which shows most crossings.
void show_steps(PhantomAnalysis &out, const Stack &stack, const RunInputs &inputs) {
  const auto nearest =
      std::min_element(out.planes.begin(), out.planes.end(), [](const PhantomPlane &a, const PhantomPlane &b) {
        return std::abs(a.at_mm - kShownPlane_mm) < std::abs(b.at_mm - kShownPlane_mm);
      });
  if (nearest == out.planes.end()) {
    return;
  }
  const Vector3d normal = out.axes.col(2), spacing = stack.spacing_mm();
  const double first = normal.dot(stack.origin_mm()), step = normal.dot(stack.axes().col(2));
  const auto middle = static_cast<int>(std::lround((nearest->at_mm - first) / step));
  const std::size_t pixels = static_cast<std::size_t>(stack.size[0]) * static_cast<std::size_t>(stack.size[1]);
  for (int k = middle - kTriedSlices; k <= middle + kTriedSlices; ++k) {
    if (k < 0 || k >= stack.size[2]) {
      continue;
    }
    const auto *from = stack.voxels.data() + static_cast<std::size_t>(k) * pixels;
    std::vector<mri::CrossingStage> stages;
    const auto crossings = mri::slice_crossings({from, from + pixels}, stack.size[0], stack.size[1], spacing.head<2>(),
                                                {.cell_mm = inputs.cell_mm, .bar_mm = inputs.bar_mm}, &stages);
    if (crossings.size() > out.crossings.size() && !stages.empty()) {
      out.crossings.clear();
      const double scale_x = static_cast<double>(stages.front().columns) / stack.size[0];
      const double scale_y = static_cast<double>(stages.front().rows) / stack.size[1];
      for (const Eigen::Vector2d &p : crossings) {
        out.crossings.emplace_back((p.x() + 0.5) * scale_x - 0.5, (p.y() + 0.5) * scale_y - 0.5);
      }
      out.stages = std::move(stages);
      out.slice_mm = first + k * step;
    }
  }
}

base::Result<PhantomAnalysis> analyse_phantom(const RunRecord &record, const RunInputs &inputs) {
  if (inputs.phantom_mm.cols() == 0) {
    return base::failure("no control points of the phantom in CT were given");
  }
  const ReceivedSeries *series = record.largest("phantom");
  const auto device = series == nullptr ? std::nullopt : series->stack();
  if (!device) {
    return base::failure("no complete series of the phantom was received");
  }
  const Eigen::Matrix4d T_image_device =
      (mri::T_image_patient() * mri::T_device_patient(position_of(series->header)).inverse()).matrix();
  Stack image = *device;
  image.T_image_index = T_image_device * image.T_image_index;
  mri::GridOptions options;
  options.cell_mm = inputs.cell_mm;
  options.bar_mm = inputs.bar_mm;
  const auto found = mri::find_grid_points(image, options);
  if (!found) {
    return base::failure(found.error());
  }
  const mri::MatchResult match = mri::match_points(inputs.phantom_mm, found->points_mm);
  if (match.outcome != mri::MatchOutcome::kMatched) {
    return base::failure(std::string("control points in CT and MR: ") + mri::name(match.outcome));
  }
  PhantomAnalysis out;
  const Eigen::Matrix4d T_device_image = T_image_device.inverse();
  out.true_mm = moved(T_device_image, match.reference_points(inputs.phantom_mm));
  out.imaged_mm = moved(T_device_image, match.imaged_points(found->points_mm));
  out.unmatched = match.reference_unmatched.size() + match.imaged_unmatched.size();
  auto field = mri::DistortionField::fit(out.true_mm, out.imaged_mm);
  const auto after = mri::hold_out(out.true_mm, out.imaged_mm);
  if (!field || !after) {
    return base::failure(!field ? field.error() : after.error());
  }
  out.field = std::move(*field);
  out.before = mri::summarise(out.imaged_mm - out.true_mm);
  out.after = *after;
  const Eigen::Matrix3d axes = device->axes();
  out.axes << axes.col(0).normalized(), axes.col(1).normalized(), axes.col(0).cross(axes.col(1)).normalized();
  out.planes = planes_of(out.true_mm, out.imaged_mm, out.axes.col(2));
  show_steps(out, *device, inputs);
  return out;
}

void analyse_errors(RunAnalysis &out, const RunRecord &record, const RunInputs &inputs) {
  out.target_error_mm = out.predicted_95_mm = out.tip_error_mm = out.tip_predicted_95_mm = geometry::kUnknown;
  const auto &state = record.state();
  if (state && state->validity == bregma_wire_SCANNER_VALID) {
    out.predicted_95_mm = state->accepted_tre_95_mm;
    if (inputs.T_device_base) {
      const auto T = wire::from_wire<mri::frame::Base, mri::frame::Device>(state->accepted_T_base_scanner);
      out.target_error_mm = (T * (*inputs.T_device_base * inputs.target_mm) - inputs.target_mm).norm();
    }
  }
  const auto &tool = record.tool();
  if (tool && tool->scanner_status == bregma_wire_POSE_LIVE) {
    out.tip_predicted_95_mm = tool->scanner_error_95_mm;
    if (inputs.T_device_base) {
      struct Tip;
      const auto shown = wire::from_wire<mri::frame::Device, Tip>(tool->T_scanner_tip);
      const auto in_base = wire::from_wire<mri::frame::Base, Tip>(tool->T_base_tip);
      out.tip_error_mm = (shown.translation() - *inputs.T_device_base * in_base.translation()).norm();
    }
  }
}

} // namespace

RunAnalysis analyse(const RunRecord &record, const RunInputs &inputs) {
  RunAnalysis out;
  auto phantom = analyse_phantom(record, inputs);
  if (phantom) {
    out.phantom = std::move(*phantom);
  } else {
    out.phantom_missing = phantom.error().message;
  }
  std::vector<std::string> protocols;
  for (const ReceivedSeries &series : record.series()) {
    if (std::find(protocols.begin(), protocols.end(), series.protocol()) == protocols.end()) {
      protocols.push_back(series.protocol());
    }
  }
  for (const std::string &protocol : protocols) {
    const RunRecord::Pair pair = record.pair_of(protocol);
    if (pair.foreground == nullptr) {
      continue;
    }
    auto background = pair.background->stack(), foreground = pair.foreground->stack();
    if (!background || !foreground) {
      continue;
    }
    auto search = mri::find_artefacts(*background, *foreground);
    if (search) {
      out.coils.push_back({protocol, std::move(*background), std::move(*foreground), std::move(*search)});
    }
  }
  analyse_errors(out, record, inputs);
  return out;
}

} // namespace bregma::cli::mri_report
