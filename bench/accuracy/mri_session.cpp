#include "bench/accuracy/mri_session.hpp"

#include <algorithm>
#include <cmath>

#include "algorithms/mri/grid/grid_points.hpp"
#include "algorithms/mri/point_matching.hpp"
#include "algorithms/registration/points/paired_points.hpp"

namespace bregma::bench {

namespace {

using namespace sim::scanner;

constexpr double kCoarserCt = 3.0; // times the voxels of the paper's CT, for memory and time

// A normal error with this mean length.
double sigma_of_mean(double mean_mm) { return mean_mm / std::sqrt(8.0 / M_PI); }

// As an estimator knows it: the shift of slices depends on the pulse, which no header states.
Vector3d b0_movement(const Protocol &protocol, const StackPlan &plan) {
  return mri::b0_movement(plan.read_out(), protocol.pixel_mm(), protocol.bandwidth_Hz);
}

StackPlan reversed(StackPlan plan) {
  plan.read_reversed = !plan.read_reversed;
  return plan;
}

} // namespace

StackPlan pillar_plan(bool top, int slices) { return plan_of(Plane::kCoronal, Vector3d(0, top ? 55 : -55, 0), slices); }

StackPlan tree_plan(Plane plane) {
  const int slices = plane == Plane::kCoronal ? 60 : plane == Plane::kSagittal ? 100 : 120;
  return plan_of(plane, Vector3d(0, plane == Plane::kCoronal ? 5 : 0, 0), slices);
}

std::optional<Rigid3<mri::frame::Base, mri::frame::Device>> least_squares(const mri::CoilFrame &frame,
                                                                          const std::vector<mri::LocatedCoil> &coils) {
  std::vector<Vector3d> source, target;
  for (const mri::LocatedCoil &c : coils) {
    if (c.coil >= 0) { // named
      source.push_back(c.position_mm);
      target.push_back(frame.coils[static_cast<std::size_t>(c.coil)].position_mm);
    }
  }
  const auto T = registration::fit_rigid(source, target);
  return T ? std::optional(T->as<mri::frame::Base, mri::frame::Device>()) : std::nullopt;
}

MriSession::MriSession(const ScannerOptions &options, std::uint64_t seed)
    : scanner_(std::make_unique<SimulatedScanner>(options, seed)), seed_(seed), design_(options.phantom) {
  name_coils(options);
}

MriSession::MriSession(const ScannerOptions &options, std::uint64_t seed, const MriSession &mapped)
    : scanner_(std::make_unique<SimulatedScanner>(options, seed, mapped.scanner_->shared_field())), seed_(seed),
      read_outs_(mapped.read_outs_), design_(options.phantom), field_(mapped.field_), separated_(mapped.separated_) {
  name_coils(options);
}

void MriSession::name_coils(const ScannerOptions &options) {
  frame_.name = "tuna";
  frame_.build_sigma_mm = options.errors.build_mm;
  for (const CoilDesign &c : scanner_->design()) {
    frame_.coils.push_back({c.name, c.group, c.position_mm});
  }
}

std::vector<int> MriSession::coils_of(const std::vector<std::string> &groups) const {
  std::vector<int> out;
  for (std::size_t i = 0; i < frame_.coils.size(); ++i) {
    if (std::find(groups.begin(), groups.end(), frame_.coils[i].group) != groups.end()) {
      out.push_back(static_cast<int>(i));
    }
  }
  return out;
}

std::optional<MriSession::Pairs> MriSession::disturbed_points() const {
  sim::Random random(seed_, "control points");
  const Acquisition acquisition(scanner_->field(), phantom_protocol(), scanner_->phantom_plan());
  const std::vector<Vector3d> &crossings = scanner_->truth().crossings_mm;
  std::vector<Vector3d> ct, mr;
  for (const Vector3d &p : crossings) {
    ct.push_back(p + random.normal3(sigma_of_mean(0.08)));
    mr.push_back(acquisition.believed_mm(p) + random.normal3(sigma_of_mean(0.15)));
  }
  const auto T = registration::fit_rigid(ct, mr);
  if (!T) {
    return std::nullopt;
  }
  Pairs out{geometry::Points3(3, static_cast<Eigen::Index>(ct.size())), {}};
  out.imaged = out.real;
  for (std::size_t i = 0; i < ct.size(); ++i) {
    out.real.col(static_cast<Eigen::Index>(i)) = *T * ct[i];
    out.imaged.col(static_cast<Eigen::Index>(i)) = mr[i];
  }
  return out;
}

// Gradients and B0 from points that are disturbed in the same way, in two scans.
bool MriSession::map_opposed() {
  const auto forward = disturbed_points();
  if (!forward) {
    return false;
  }
  sim::Random random(seed_, "control points, reversed");
  const Acquisition acquisition(scanner_->field(), phantom_protocol(), reversed(scanner_->phantom_plan()));
  const std::vector<Vector3d> &crossings = scanner_->truth().crossings_mm;
  const Vector3d d = b0_movement(phantom_protocol(), scanner_->phantom_plan());
  mri::PhantomScan one{forward->imaged, d}, other{forward->imaged, -d};
  for (std::size_t i = 0; i < crossings.size(); ++i) {
    other.imaged_mm.col(static_cast<Eigen::Index>(i)) =
        acquisition.believed_mm(crossings[i]) + random.normal3(sigma_of_mean(0.15));
  }
  auto field = mri::separate_fields(forward->real, std::vector{one, other});
  if (!field) {
    return false;
  }
  separated_ = std::make_shared<const mri::SeparatedField>(std::move(*field));
  field_ = std::shared_ptr<const mri::DistortionField>(separated_, &separated_->gradients);
  return true;
}

Vector3d MriSession::shown_mm(const Vector3d &real_mm, const Protocol &protocol, const StackPlan &plan,
                              ReadOuts read_outs) const {
  const Vector3d forward = Acquisition(scanner_->field(), protocol, plan).believed_mm(real_mm);
  return read_outs == ReadOuts::kOne
             ? forward
             : 0.5 * (forward + Acquisition(scanner_->field(), protocol, reversed(plan)).believed_mm(real_mm));
}

std::optional<MriSession::Pairs> MriSession::points_from_images() {
  mri::GridOptions grid;
  grid.cell_mm = design_.pitch_mm();
  grid.bar_mm = design_.bar_mm;
  const auto mr = mri::find_grid_points(scanner_->phantom(phantom_protocol(), scanner_->phantom_plan()), grid);
  grid.bright = true;
  const auto ct = mri::find_grid_points(scanner_->ct(kCoarserCt), grid);
  if (!ct || !mr) {
    return std::nullopt;
  }
  const mri::MatchResult match = mri::match_points(ct->points_mm, mr->points_mm);
  if (match.outcome != mri::MatchOutcome::kMatched) {
    return std::nullopt;
  }
  return Pairs{match.reference_points(ct->points_mm), match.imaged_points(mr->points_mm)};
}

bool MriSession::map_field(ControlPoints source, ReadOuts read_outs) {
  read_outs_ = read_outs;
  if (read_outs == ReadOuts::kOpposed) {
    return map_opposed();
  }
  const auto pairs = source == ControlPoints::kImages ? points_from_images() : disturbed_points();
  if (!pairs) {
    return false;
  }
  auto field = mri::DistortionField::fit(pairs->real, pairs->imaged);
  if (field) {
    field_ = std::make_shared<const mri::DistortionField>(std::move(*field));
  }
  return field.has_value();
}

std::unique_ptr<StackPair> MriSession::scan(const Protocol &protocol, const StackPlan &plan,
                                            const std::vector<std::string> &on,
                                            const std::vector<std::string> &verify) {
  auto out = std::make_unique<StackPair>();
  out->background = scanner_->background(protocol, plan);
  out->foreground = scanner_->foreground(protocol, plan, on);
  out->scan.name = name(Plane::kCoronal);
  out->scan.background = &out->background;
  out->scan.foreground = &out->foreground;
  out->scan.on = coils_of(on);
  out->scan.verify = coils_of(verify);
  if (read_outs_ == ReadOuts::kOpposed) {
    out->reversed_background = scanner_->background(protocol, reversed(plan));
    out->reversed_foreground = scanner_->foreground(protocol, reversed(plan), on);
    out->scan.reversed_background = &out->reversed_background;
    out->scan.reversed_foreground = &out->reversed_foreground;
  }
  out->normal = plan.normal();
  return out;
}

std::unique_ptr<StackPair> MriSession::vendor_corrected(const StackPair &pair) const {
  auto out = std::make_unique<StackPair>();
  out->background = sim::scanner::vendor_corrected(pair.background, scanner_->field());
  out->foreground = sim::scanner::vendor_corrected(pair.foreground, scanner_->field());
  out->scan = pair.scan;
  out->scan.background = &out->background;
  out->scan.foreground = &out->foreground;
  out->normal = pair.normal;
  return out;
}

std::optional<mri::CorrectedPoint> MriSession::corrected(const Vector3d &shown_mm, ReadOuts read_outs) const {
  const auto real = separated_ != nullptr && read_outs == ReadOuts::kOne
                        ? separated_->to_true(shown_mm, b0_movement(coil_protocol(60), tree_plan(Plane::kCoronal)))
                        : field_->to_true(shown_mm);
  if (!real) {
    return std::nullopt;
  }
  const auto known = field_->assess(*real);
  if (known.coverage == mri::Coverage::kUnknown) {
    return std::nullopt;
  }
  return mri::CorrectedPoint{*real, known.sigma_mm};
}

mri::RobotRegistrationOptions MriSession::options(Images images, mri::CoilMethod method) const {
  mri::RobotRegistrationOptions out;
  out.artefacts.method = method;
  if (images == Images::kOurs) {
    out.correction = [this](const Vector3d &shown) { return corrected(shown, read_outs_); };
  } else {
    out.uncorrected_sigma_mm = images == Images::kVendor ? 0.3 : 1.0;
  }
  if (read_outs_ == ReadOuts::kOpposed) {
    const Vector3d d = b0_movement(coil_protocol(60), tree_plan(Plane::kCoronal));
    out.mapped_b0 = [this, d](const Vector3d &real) -> Vector3d { return separated_->b0_Hz(real) * d; };
  }
  return out;
}

Vector3d MriSession::error_at(int coil, const Rigid3<mri::frame::Base, mri::frame::Device> &T_base_device,
                              Images images, const Protocol &protocol, const StackPlan &plan,
                              ReadOuts read_outs) const {
  const auto i = static_cast<std::size_t>(coil);
  const Vector3d &real = scanner_->truth().coils_device_mm[i];
  Vector3d shown = shown_mm(real, protocol, plan, read_outs);
  if (images == Images::kVendor) {
    shown -= scanner_->field().gradient_mm(real);
  } else if (images == Images::kOurs) {
    const auto point = corrected(shown, read_outs);
    shown = point ? point->position_mm : Vector3d::Constant(std::nan(""));
  }
  return T_base_device * shown - scanner_->truth().T_device_base.inverse() * real;
}

} // namespace bregma::bench
