#include "algorithms/mri/coils/robot_registration.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

#include "algorithms/mri/coils/verification.hpp"
#include "algorithms/registration/points/robust_points.hpp"
#include "algorithms/uncertainty/error_metrics.hpp"
#include "algorithms/uncertainty/tre.hpp"

namespace bregma::mri {

namespace {

using Artefacts = std::vector<CoilArtefact>;

constexpr std::size_t kFewestCoils = 4;

tl::expected<Artefacts, std::string> artefacts_of(const CoilScan &scan, const ArtefactOptions &options) {
  if (scan.background == nullptr || scan.foreground == nullptr) {
    return tl::make_unexpected(scan.name + ": background or foreground is missing");
  }
  auto found = find_artefacts(*scan.background, *scan.foreground, options);
  if (!found) {
    return tl::make_unexpected(scan.name + ": " + found.error());
  }
  if (scan.opposite != nullptr) {
    const auto other = find_artefacts(*scan.background, *scan.opposite, options);
    if (!other) {
      return tl::make_unexpected(scan.name + ", current reversed: " + other.error());
    }
    found->artefacts = mean_of_polarities(found->artefacts, other->artefacts, options.window_mm);
  }
  if (scan.reversed_background != nullptr && scan.reversed_foreground != nullptr) {
    const auto reversed = find_artefacts(*scan.reversed_background, *scan.reversed_foreground, options);
    if (!reversed) {
      return tl::make_unexpected(scan.name + ", read-out reversed: " + reversed.error());
    }
    return mean_of_read_outs(found->artefacts, reversed->artefacts, options.window_mm);
  }
  return std::move(found->artefacts);
}

// Corrected position and its covariance; nothing where the field does not know.
std::optional<LocatedCoil> corrected(const CoilArtefact &artefact, int scan, const RobotRegistrationOptions &options) {
  LocatedCoil out;
  out.scan = scan;
  out.shown_mm = artefact.centre_mm;
  out.position_mm = artefact.centre_mm;
  out.covariance = artefact.covariance;
  out.b0_mm = artefact.b0_mm;
  Vector3d sigma = Vector3d::Constant(options.uncorrected_sigma_mm);
  if (options.correction) {
    const auto point = options.correction(artefact.centre_mm);
    if (!point) {
      return std::nullopt;
    }
    out.position_mm = point->position_mm;
    sigma = point->sigma_mm;
  }
  out.field_sigma_mm = sigma;
  out.covariance.diagonal() += sigma.cwiseAbs2();
  return out;
}

Vector3d normal_of(const Stack &stack) {
  const Eigen::Matrix3d axes = stack.axes();
  return axes.col(0).cross(axes.col(1)).normalized();
}

bool covers(const Stack &stack, const Vector3d &device_mm) {
  const Vector3d index = stack.axes().inverse() * (device_mm - stack.origin_mm());
  for (int d = 0; d < 3; ++d) {
    if (index[d] < 0.0 || index[d] > stack.size[static_cast<std::size_t>(d)] - 1.0) {
      return false;
    }
  }
  return true;
}

std::string text(double value, const char *unit) {
  std::string digits = std::to_string(std::round(value * 10.0) / 10.0);
  return digits.substr(0, digits.find('.') + 2) + " " + unit;
}

class Registering {
public:
  Registering(const CoilFrame &frame, std::span<const CoilScan> scans, const RobotRegistrationOptions &options)
      : frame_(frame), scans_(scans), options_(options) {}

  RobotRegistration run(std::span<const Artefacts> artefacts) {
    if (use_coils(artefacts) && name_them() && fit()) {
      judge();
    }
    return std::move(out_);
  }

private:
  bool refuse(RegistrationVerdict verdict, std::string reason) {
    out_.verdict = verdict;
    out_.reason = std::move(reason);
    return false;
  }

  bool use_coils(std::span<const Artefacts> artefacts) {
    for (std::size_t s = 0; s < scans_.size(); ++s) {
      if (s > 0 && std::abs(normal_of(*scans_[s].background).dot(normal_of(*scans_[0].background))) < 0.9998) {
        return refuse(RegistrationVerdict::kRefused, scans_[s].name +
                                                         ": its slices have another orientation than those of " +
                                                         scans_[0].name + "; scan all coils in one orientation");
      }
      int unknown = 0;
      for (const CoilArtefact &a : artefacts[s]) {
        if (a.cut_off) {
          out_.notes.push_back(scans_[s].name + ": an artefact reaches the border of the scan and is not used");
          continue;
        }
        if (auto coil = corrected(a, static_cast<int>(s), options_)) {
          out_.coils.push_back(*coil);
        } else {
          ++unknown;
        }
      }
      if (unknown > 0) {
        out_.notes.push_back(scans_[s].name + ": " + std::to_string(unknown) +
                             " coils lie where the distortion field is not known and are not used");
      }
    }
    return true;
  }

  bool name_them() {
    std::vector<std::vector<int>> on;
    for (const CoilScan &scan : scans_) {
      on.push_back(scan.on);
    }
    std::vector<Sighting> sightings;
    for (const LocatedCoil &c : out_.coils) {
      sightings.push_back({c.position_mm, c.scan});
    }
    const Naming naming = name_coils(frame_, on, sightings, options_.naming);
    if (naming.status == Naming::Status::kTooFew) {
      return refuse(RegistrationVerdict::kRefused, "of " + std::to_string(sightings.size()) +
                                                       " artefacts fewer than four fit the frame's pattern: check "
                                                       "the frame's file, the cables, and which coils carried current");
    }
    if (naming.status == Naming::Status::kTooMany) {
      return refuse(RegistrationVerdict::kRefused, std::to_string(sightings.size()) +
                                                       " artefacts are seen, too many to be named: background and "
                                                       "foreground do not show the same scene");
    }
    if (naming.status == Naming::Status::kAmbiguous) {
      return refuse(RegistrationVerdict::kAmbiguous, "the coils fit the frame in two ways (RMS " +
                                                         text(naming.rms_mm, "mm") + " and " +
                                                         text(naming.rival_rms_mm, "mm") + "): switch on more coils");
    }
    for (std::size_t i = 0; i < sightings.size(); ++i) {
      out_.coils[i].coil = naming.coil[i];
    }
    report_others(naming);
    return true;
  }

  // Artefacts without a coil that was on, and coils without an artefact.
  void report_others(const Naming &naming) {
    const auto T_device_base = naming.T_base_device.inverse();
    for (const LocatedCoil &c : out_.coils) {
      if (c.coil >= 0) {
        continue;
      }
      const Vector3d at = naming.T_base_device * c.position_mm;
      std::string what = "an artefact is at no coil of the frame";
      for (const FrameCoil &other : frame_.coils) {
        if ((other.position_mm - at).norm() < options_.naming.tolerance_mm) {
          const bool was_on = std::any_of(
              scans_[static_cast<std::size_t>(c.scan)].on.begin(), scans_[static_cast<std::size_t>(c.scan)].on.end(),
              [&](int n) { return frame_.coils[static_cast<std::size_t>(n)].name == other.name; });
          what = was_on ? other.name + " appears twice; only the nearer artefact is used"
                        : other.name + " carries current though it was not switched on: its cable may be swapped";
          break;
        }
      }
      out_.notes.push_back(scans_[static_cast<std::size_t>(c.scan)].name + ": " + what);
    }
    for (const int m : naming.missing) {
      const FrameCoil &coil = frame_.coils[static_cast<std::size_t>(m)];
      const Vector3d at = T_device_base * coil.position_mm;
      const bool in_scan = std::any_of(scans_.begin(), scans_.end(), [&](const CoilScan &scan) {
        return std::find(scan.on.begin(), scan.on.end(), m) != scan.on.end() && covers(*scan.background, at);
      });
      out_.notes.push_back(coil.name + (in_scan ? " is missing: no current, or no signal around it"
                                                : " lies outside the scanned volume"));
    }
    std::erase_if(out_.coils, [](const LocatedCoil &c) { return c.coil < 0; });
    std::erase_if(out_.coils, [&](const LocatedCoil &c) {
      const std::vector<int> &verify = scans_[static_cast<std::size_t>(c.scan)].verify;
      if (std::find(verify.begin(), verify.end(), c.coil) == verify.end()) {
        return false;
      }
      out_.verified.push_back(c);
      return true;
    });
  }

  bool fit() {
    std::vector<registration::PointPair> pairs;
    const double build = frame_.build_sigma_mm * frame_.build_sigma_mm;
    for (const LocatedCoil &c : out_.coils) {
      pairs.push_back({c.position_mm, frame_.coils[static_cast<std::size_t>(c.coil)].position_mm, c.covariance,
                       build * Eigen::Matrix3d::Identity()});
    }
    if (pairs.size() < kFewestCoils) {
      return refuse(RegistrationVerdict::kRefused, "only " + std::to_string(pairs.size()) +
                                                       " of the coils that are seen register, the others verify: four "
                                                       "are needed");
    }
    const registration::RobustFit robust = registration::fit_paired_robust(pairs);
    if (!robust.found) {
      return refuse(
          RegistrationVerdict::kInconsistent,
          "the coils do not agree with the frame within their errors (RMS " +
              text(coil_error_rms_mm(frame_, out_.coils,
                                     robust.fit.converged ? robust.fit.T_target_source.as<frame::Base, frame::Device>()
                                                          : Rigid3<frame::Base, frame::Device>()),
                   "mm") +
              "): correct the distortion, or look for coils that have moved");
    }
    out_.T_base_device = {robust.fit.T_target_source.as<frame::Base, frame::Device>(), robust.fit.covariance};
    out_.fre_mm = robust.fit.fre_mm;
    out_.fre_expected_mm = robust.fit.fre_expected_mm;
    out_.p_value = robust.fit.p_value;
    for (std::size_t i = 0; i < out_.coils.size(); ++i) {
      LocatedCoil &c = out_.coils[i];
      const FrameCoil &drawn = frame_.coils[static_cast<std::size_t>(c.coil)];
      c.residual_mm = (out_.T_base_device.pose * c.position_mm - drawn.position_mm).norm();
      c.used = robust.inlier[i];
      if (!c.used) {
        out_.notes.push_back(drawn.name + " is " + text(c.residual_mm, "mm") +
                             " from its place and is not used: it may have moved on the frame");
      }
    }
    return true;
  }

  void judge() {
    for (LocatedCoil &c : out_.verified) {
      c.used = true;
      c.residual_mm =
          (out_.T_base_device.pose * c.position_mm - frame_.coils[static_cast<std::size_t>(c.coil)].position_mm).norm();
    }
    Verification verification;
    verification.rms_mm = coil_error_rms_mm(frame_, out_.verified, out_.T_base_device.pose);
    if (out_.verified.size() >= kMinVerifyingCoils) {
      verification = verify_registration(frame_, out_.verified, out_.verified.size(), out_.T_base_device, out_.coils,
                                         unit_axes(*scans_[0].background), options_);
      out_.T_base_device.covariance.bottomRightCorner<3, 3>() += verification.unexplained;
    }
    out_.verified_mm = verification.rms_mm;
    out_.b0_change_mm = b0_change(out_.coils, out_.verified, out_.T_base_device.pose, options_.mapped_b0).max_mm;
    out_.tre_95_mm = predicted_95_mm(out_.T_base_device, options_.target_mm);
    std::vector<LocatedCoil> used;
    std::copy_if(out_.coils.begin(), out_.coils.end(), std::back_inserter(used),
                 [](const LocatedCoil &c) { return c.used; });
    out_.opme_mm = coil_out_of_plane_mm(frame_, used, out_.T_base_device.pose, normal_of(*scans_[0].background));
    const auto &R = out_.T_base_device.pose.rotation();
    if (options_.expected_rotation &&
        geometry::angle_between(*options_.expected_rotation, R) > options_.max_rotation_deg * M_PI / 180.0) {
      refuse(
          RegistrationVerdict::kRefused,
          "the frame would lie " +
              text(geometry::angle_between(*options_.expected_rotation, R) * 180.0 / M_PI, "degrees") +
              " from where it is mounted: check the cables, the frame's file and the patient position of the series");
    } else if (out_.p_value < options_.min_p_value) {
      refuse(RegistrationVerdict::kInconsistent, "FRE " + text(out_.fre_mm, "mm") + " where " +
                                                     text(out_.fre_expected_mm, "mm") +
                                                     " is expected: the errors are larger than stated");
    } else if (!verification.failure.empty()) {
      refuse(RegistrationVerdict::kInconsistent, verification.failure);
    } else if (!(out_.tre_95_mm <= options_.limit_mm)) {
      refuse(RegistrationVerdict::kInaccurate, "predicted error at the target " + text(out_.tre_95_mm, "mm") +
                                                   " (95 %), limit " + text(options_.limit_mm, "mm") +
                                                   ": use more coils, farther apart");
    } else {
      out_.verdict = RegistrationVerdict::kFound;
    }
  }

  const CoilFrame &frame_;
  std::span<const CoilScan> scans_;
  const RobotRegistrationOptions &options_;
  RobotRegistration out_;
};

} // namespace

const char *name(RegistrationVerdict verdict) noexcept {
  switch (verdict) {
  case RegistrationVerdict::kFound:
    return "found";
  case RegistrationVerdict::kInaccurate:
    return "inaccurate";
  case RegistrationVerdict::kInconsistent:
    return "inconsistent";
  case RegistrationVerdict::kAmbiguous:
    return "ambiguous";
  case RegistrationVerdict::kRefused:
    return "refused";
  }
  return "";
}

RobotRegistration register_artefacts(const CoilFrame &frame, std::span<const CoilScan> scans,
                                     std::span<const std::vector<CoilArtefact>> artefacts,
                                     const RobotRegistrationOptions &options) {
  RobotRegistration refused;
  if (artefacts.size() != scans.size() || scans.empty()) {
    refused.reason =
        "there are " + std::to_string(scans.size()) + " scans and artefacts of " + std::to_string(artefacts.size());
    return refused;
  }
  return Registering(frame, scans, options).run(artefacts);
}

RobotRegistration register_robot(const CoilFrame &frame, std::span<const CoilScan> scans,
                                 const RobotRegistrationOptions &options) {
  std::vector<Artefacts> artefacts;
  for (const CoilScan &scan : scans) {
    auto found = artefacts_of(scan, options.artefacts);
    if (!found) {
      RobotRegistration refused;
      refused.reason = found.error();
      return refused;
    }
    artefacts.push_back(std::move(*found));
  }
  return register_artefacts(frame, scans, artefacts, options);
}

tl::expected<std::vector<LocatedCoil>, std::string> locate_targets(const CoilFrame &frame, const CoilScan &scan,
                                                                   const RobotRegistration &registration,
                                                                   const RobotRegistrationOptions &options) {
  const auto found = artefacts_of(scan, options.artefacts);
  if (!found) {
    return tl::make_unexpected(found.error());
  }
  std::vector<LocatedCoil> out;
  for (const int c : scan.on) {
    const Vector3d &drawn = frame.coils[static_cast<std::size_t>(c)].position_mm;
    std::optional<LocatedCoil> best;
    double nearest = options.naming.tolerance_mm;
    for (const CoilArtefact &a : *found) {
      const auto located = a.cut_off ? std::nullopt : corrected(a, 0, options);
      if (!located) {
        continue;
      }
      const double d = (registration.T_base_device.pose * located->position_mm - drawn).norm();
      if (d < nearest) {
        nearest = d;
        best = located;
      }
    }
    if (best) {
      best->coil = c;
      best->residual_mm = nearest;
      best->used = true;
      out.push_back(*best);
    }
  }
  return out;
}

double coil_error_rms_mm(const CoilFrame &frame, std::span<const LocatedCoil> coils,
                         const Rigid3<frame::Base, frame::Device> &T_base_device) {
  std::vector<Vector3d> source, target;
  for (const LocatedCoil &c : coils) {
    if (c.coil >= 0) {
      source.push_back(c.position_mm);
      target.push_back(frame.coils[static_cast<std::size_t>(c.coil)].position_mm);
    }
  }
  return uncertainty::rms_distance_mm(T_base_device.as<geometry::frame::Target, geometry::frame::Source>(), source,
                                      target);
}

double coil_out_of_plane_mm(const CoilFrame &frame, std::span<const LocatedCoil> coils,
                            const Rigid3<frame::Base, frame::Device> &T_base_device, const Vector3d &normal_device) {
  std::vector<Vector3d> source, target;
  for (const LocatedCoil &c : coils) {
    if (c.coil >= 0) {
      source.push_back(c.position_mm);
      target.push_back(frame.coils[static_cast<std::size_t>(c.coil)].position_mm);
    }
  }
  return uncertainty::out_of_plane_mean_error_mm(T_base_device.as<geometry::frame::Target, geometry::frame::Source>(),
                                                 source, target, T_base_device.rotation() * normal_device);
}

double predicted_95_mm(const geometry::UncertainPose<frame::Base, frame::Device> &T_base_device,
                       const Vector3d &target_mm) {
  return uncertainty::ellipsoid_95(uncertainty::tre_covariance(T_base_device.covariance, target_mm)).semi_axes_mm[0];
}

Rigid3<frame::Base, frame::Slice> T_base_slice(const Rigid3<frame::Base, frame::Device> &T_base_device,
                                               const SlicePlane &plane) {
  return T_base_device * plane.T_device_slice();
}

} // namespace bregma::mri
