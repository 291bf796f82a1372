#include "drivers/sim/scanner/simulated_scanner.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::sim::scanner {

namespace {

constexpr double kMain_T = 3.0;     // along Device's z
constexpr double kAirInWater = 9.4; // ppm, difference of susceptibility

BodyPose placed(const Eigen::Matrix3d &turn, const Vector3d &at_mm, const HiddenErrors &errors, Random &random) {
  const Eigen::Quaterniond tilt = geometry::rotation_exp(random.normal3(errors.placement_deg * M_PI / 180.0));
  const Vector3d off = random.normal3(errors.placement_mm);
  return {(tilt * Eigen::Quaterniond(turn)).toRotationMatrix(), at_mm + off};
}

// The frame's z (along its pillars) is up.
Eigen::Matrix3d upright() {
  Eigen::Matrix3d out;
  out << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  return out;
}

bool same(const Protocol &a, const Protocol &b) {
  return a.fov_mm == b.fov_mm && a.matrix == b.matrix && a.thickness_mm == b.thickness_mm &&
         a.bandwidth_Hz == b.bandwidth_Hz && a.pulse_Hz == b.pulse_Hz && a.echo_ms == b.echo_ms;
}
bool same(const StackPlan &a, const StackPlan &b) {
  return a.along_row == b.along_row && a.along_column == b.along_column && a.centre_mm == b.centre_mm &&
         a.slices == b.slices && a.read_out() == b.read_out();
}

// Two kinds of coils; their tables of elliptic integrals are made once.
const CoilField &field_of(const CoilDesign &coil) {
  static const CoilField pillar(shape_of(frame_design().front())), tree(shape_of(frame_design().back()));
  return coil.group == "tree" ? tree : pillar;
}

// A ball's field is that of a dipole; d: from its centre, outside it.
double dipole_Hz(const Vector3d &d, double radius_mm, double ppm) {
  const double distance = d.norm(), cosine = d.z() / distance;
  return kGamma_HzPerT * kMain_T * ppm * 1e-6 / 3.0 * std::pow(radius_mm / distance, 3) * (3.0 * cosine * cosine - 1.0);
}

} // namespace

SimulatedScanner::SimulatedScanner(const ScannerOptions &options, std::uint64_t seed,
                                   std::shared_ptr<const ScannerField> field)
    : options_(options), seed_(seed), noise_(seed, "noise"), drift_(seed, "drift"), ripple_(seed, "ripple"),
      design_(frame_design()), broken_(design_.size(), false), frame_(design_), phantom_(options.phantom),
      field_(std::move(field)) {
  Random build(seed, "build");
  Random place(seed, "place");
  for (const CoilDesign &coil : design_) {
    built_mm_.push_back(coil.position_mm + build.normal3(options.errors.build_mm));
  }
  // The paper's phantom reached to -89 mm along the normal of its coronal slices (-y here).
  truth_.T_device_phantom = placed(Eigen::Matrix3d::Identity(), Vector3d(0.0, 3.5, 0.0), options.errors, place);
  truth_.T_ct_phantom = placed(Eigen::Matrix3d::Identity(), Vector3d::Zero(), options.errors, place);
  truth_.T_device_base = placed(upright(), Vector3d::Zero(), options.errors, place);
  for (const Vector3d &p : phantom_.crossings_mm()) {
    truth_.crossings_mm.push_back(truth_.T_device_phantom * p);
  }
  place_coils();
  if (field_ == nullptr) {
    field_ = std::make_shared<const ScannerField>(options.field, truth_.crossings_mm, seed);
  }
}

void SimulatedScanner::place_coils() {
  truth_.coils_device_mm.clear();
  for (const Vector3d &p : built_mm_) {
    truth_.coils_device_mm.push_back(truth_.T_device_base * p);
  }
}

void SimulatedScanner::move_frame(const BodyPose &T_device_base) {
  truth_.T_device_base = T_device_base;
  place_coils();
  scan_.reset();
}

void SimulatedScanner::set_field(ScannerField field) {
  scan_.reset(); // it refers to the former field
  field_ = std::make_shared<const ScannerField>(std::move(field));
}

void SimulatedScanner::enter_ball(double ppm, const Vector3d &centre_mm, double radius_mm) {
  set_field(field_->with_b0([=](const Vector3d &r) {
    const Vector3d d = r - centre_mm;
    return d.norm() < radius_mm ? 0.0 : dipole_Hz(d, radius_mm, ppm);
  }));
}

Stack SimulatedScanner::ct(double coarser) {
  Stack out;
  out.size = {static_cast<int>(512 / coarser), static_cast<int>(512 / coarser), static_cast<int>(319 / coarser)};
  const Vector3d spacing(216.0 / out.size[0], 216.0 / out.size[1], 0.6 * 319.0 / out.size[2]);
  out.T_image_index.diagonal().head<3>() = spacing;
  for (int d = 0; d < 3; ++d) {
    out.T_image_index(d, 3) = -0.5 * spacing[d] * (out.size[static_cast<std::size_t>(d)] - 1);
  }
  out.voxels.resize(out.pixels());
  const auto T_phantom_ct = truth_.T_ct_phantom.inverse();
  const Eigen::Matrix3d R = T_phantom_ct.rotation_matrix();
  const double ramp = std::cbrt(spacing.prod());
  Random noise(seed_, "ct");
  std::size_t at = 0;
  for (int k = 0; k < out.size[2]; ++k) {
    for (int j = 0; j < out.size[1]; ++j) {
      for (int i = 0; i < out.size[0]; ++i, ++at) {
        const Vector3d p = R * out.point_mm(Vector3d(i, j, k)) + T_phantom_ct.translation();
        out.voxels[at] =
            static_cast<float>(1000.0 * phantom_.plastic(p, ramp) + noise.normal(options_.errors.ct_noise));
      }
    }
  }
  return out;
}

StackPlan SimulatedScanner::phantom_plan(Plane plane) const {
  return plan_of(plane, Vector3d(0.0, 3.5, 0.0), static_cast<int>(std::ceil(options_.phantom.size_mm())) + 29);
}

Stack SimulatedScanner::phantom(const Protocol &protocol, const StackPlan &plan) {
  const Acquisition acquisition(*field_, protocol, plan);
  const Stack clean = acquisition.clean(phantom_, truth_.T_device_phantom);
  if (options_.errors.bubbles == 0) {
    return received(clean, nullptr, Vector3d::Zero(), options_.appearance, seed_, noise_);
  }
  const auto added = acquisition.added(phantom_, truth_.T_device_phantom, bubbles());
  return received(clean, &added, Vector3d::Zero(), options_.appearance, seed_, noise_);
}

LocalField SimulatedScanner::bubbles() {
  struct Bubble {
    Vector3d centre_mm;
    double radius_mm;
  };
  Random random(seed_, "bubbles");
  std::vector<Bubble> list;
  LocalField out;
  out.reach_mm = 12.0;
  out.step_mm = 0.4;
  for (int n = 0; n < options_.errors.bubbles; ++n) { // they cling to the bars
    const auto at = static_cast<std::size_t>(random.uniform(0.0, static_cast<double>(truth_.crossings_mm.size())));
    const Vector3d off = random.uniform(2.0, 5.0) * random.direction();
    list.push_back({truth_.crossings_mm[std::min(at, truth_.crossings_mm.size() - 1)] + off, random.uniform(1.0, 2.5)});
    out.centres_mm.push_back(list.back().centre_mm);
  }
  out.frequency_Hz = [list](const Vector3d &r) {
    double sum = 0.0;
    for (const Bubble &b : list) {
      const Vector3d d = r - b.centre_mm;
      if (d.norm() < 30.0 && d.norm() > 0.0) {
        sum += dipole_Hz(d * std::max(1.0, b.radius_mm / d.norm()), b.radius_mm, kAirInWater); // inside: no spins
      }
    }
    return sum;
  };
  out.is_empty = [list](const Vector3d &r) {
    return std::any_of(list.begin(), list.end(),
                       [&](const Bubble &b) { return (r - b.centre_mm).norm() < b.radius_mm; });
  };
  return out;
}

LocalField SimulatedScanner::currents(const std::vector<std::string> &groups, int polarity) {
  struct Live {
    Vector3d centre_mm, axis;
    double current_A;
    const CoilField *field;
  };
  std::vector<Live> list;
  LocalField out;
  for (std::size_t i = 0; i < design_.size(); ++i) {
    const double current =
        polarity * options_.current_mA * 1e-3 * (1.0 + ripple_.normal(options_.errors.current_ripple));
    if (broken_[i] || std::find(groups.begin(), groups.end(), design_[i].group) == groups.end()) {
      continue;
    }
    list.push_back(
        {truth_.coils_device_mm[i], truth_.T_device_base.rotation() * design_[i].axis, current, &field_of(design_[i])});
    out.centres_mm.push_back(list.back().centre_mm);
  }
  out.frequency_Hz = [list](const Vector3d &r) { // only the part along the main field counts
    double sum = 0.0;
    for (const Live &coil : list) {
      const Vector3d d = r - coil.centre_mm;
      if (d.squaredNorm() < 40.0 * 40.0) {
        sum += kGamma_HzPerT * coil.current_A * (*coil.field)(d, coil.axis).z();
      }
    }
    return sum;
  };
  return out;
}

const SimulatedScanner::Scan &SimulatedScanner::scan_of(const Protocol &protocol, const StackPlan &plan) {
  if (scan_ == nullptr || !same(scan_->protocol, protocol) || !same(scan_->plan, plan)) {
    auto acquisition = std::make_unique<Acquisition>(*field_, protocol, plan);
    std::vector<Vector3d> fine;
    for (std::size_t i = 0; i < design_.size(); ++i) {
      const std::vector<std::string> &groups = options_.fine_groups;
      if (groups.empty() || std::find(groups.begin(), groups.end(), design_[i].group) != groups.end()) {
        fine.push_back(truth_.coils_device_mm[i]);
      }
    }
    Stack clean = acquisition->clean(frame_, truth_.T_device_base, fine);
    scan_ = std::make_unique<Scan>(Scan{protocol, plan, std::move(acquisition), std::move(clean)});
  }
  return *scan_;
}

Stack SimulatedScanner::background(const Protocol &protocol, const StackPlan &plan) {
  return received(scan_of(protocol, plan).clean, nullptr, Vector3d::Zero(), options_.appearance, seed_, noise_);
}

Stack SimulatedScanner::foreground(const Protocol &protocol, const StackPlan &plan,
                                   const std::vector<std::string> &groups, int polarity) {
  const Scan &scan = scan_of(protocol, plan);
  const Vector3d drift = drift_.normal3(options_.errors.drift_mm);
  const auto added = scan.acquisition->added(frame_, truth_.T_device_base, currents(groups, polarity));
  return received(scan.clean, &added, drift, options_.appearance, seed_, noise_);
}

} // namespace bregma::sim::scanner
