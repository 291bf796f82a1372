#include "algorithms/intensity/rigid_verdict.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <utility>
#include <vector>

#include "algorithms/intensity/pose_optimiser.hpp"

namespace bregma::intensity {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kMinLead = 0.15;
constexpr double kMinMirrorLead = -kSidesKnown; // means of many heads are so symmetric that 0 would be chance
// A head that an affine map explains better by this part of the scale, and that is larger or smaller by this, is not
// that of the other image (docs/images.md).
constexpr double kMaxStretch = 0.02;
constexpr double kMinStretchGain = 0.1;
constexpr double kMinOverlap = 0.25;
constexpr double kMinInformation = 0.03; // nats per sample
constexpr double kMaxError_mm = 3.0;     // predicted, rms at kArm_mm

std::string number(double value, int digits) {
  std::array<char, 32> out{};
  std::snprintf(out.data(), out.size(), "%.*f", digits, value);
  return out.data();
}

// The anatomical axis next to a direction of the reference.
std::string direction_text(const Vector3d &direction) {
  constexpr std::array kNames{"left-right", "posterior-anterior", "inferior-superior"};
  Eigen::Index axis = 0;
  direction.cwiseAbs().maxCoeff(&axis);
  return kNames[static_cast<std::size_t>(axis)];
}

// Number of distinct values; counts no further than `enough`.
std::size_t grey_values(const Volume &image, std::size_t enough) {
  std::vector<float> known;
  for (const float v : image.voxels) {
    if (std::isfinite(v) && std::find(known.begin(), known.end(), v) == known.end()) {
      known.push_back(v);
      if (known.size() == enough) {
        break;
      }
    }
  }
  return known.size();
}

// Of T2 or CT onto T1, by `bench intensity --only measures` (docs/images.md).
bool finds_wrong_poses(Measure measure) {
  return measure == Measure::kQMi || measure == Measure::kRmi || measure == Measure::kCmi;
}

} // namespace

std::string obstacle(const Volume &image, std::string_view name) {
  constexpr int kMinVoxels = 4;
  for (const int size : image.size) {
    if (size < kMinVoxels) {
      return "the " + std::string(name) + " image has " + std::to_string(size) + (size == 1 ? " slice" : " slices") +
             " along an axis; at least " + std::to_string(kMinVoxels) + " are needed for a pose in space";
    }
  }
  if (grey_range(image.voxels).constant()) {
    return "the " + std::string(name) + " image has one grey value only";
  }
  constexpr std::size_t kMinGreyValues = 8;
  if (const std::size_t count = grey_values(image, kMinGreyValues); count < kMinGreyValues) {
    return "the " + std::string(name) + " image has " + std::to_string(count) +
           " grey values only: a mask or a segmentation, not a scan?";
  }
  return {};
}

void judge(RigidImageResult &out, const Vector3d &centre_mm, const RigidImageOptions &options) {
  const auto say = [&](ImageVerdict verdict, std::string reason) {
    out.verdict = verdict;
    out.reason = std::move(reason);
  };
  const geometry::Matrix36d J = geometry::point_jacobian(centre_mm);
  const Matrix3d at_centre = J * out.covariance * J.transpose();
  const double rotation = out.covariance.topLeftCorner<3, 3>().trace() * kArm_mm * kArm_mm * 2.0 / 3.0;
  const double predicted = std::sqrt(at_centre.trace() + rotation);
  const std::string returned = std::to_string(out.returned) + " of " + std::to_string(out.restarts) +
                               " restarts from perturbed poses came back to this one";
  if (!(out.overlap >= kMinOverlap)) {
    say(ImageVerdict::kRefused, "the images overlap by " + number(100.0 * out.overlap, 0) + " % of the smaller one; " +
                                    number(100.0 * kMinOverlap, 0) + " % are needed");
  } else if (!(out.mutual_information >= kMinInformation)) {
    say(ImageVerdict::kRefused, "the images share too little (mutual information " + number(out.mutual_information, 3) +
                                    ", " + number(kMinInformation, 2) +
                                    " is needed): another patient or part of the body?");
  } else if (!(out.lead >= kMinLead)) {
    say(ImageVerdict::kAmbiguous, "another pose explains the images nearly as well (lead " + number(out.lead, 2) +
                                      ", " + number(kMinLead, 2) +
                                      " is needed): different anatomy, or too small a part of it");
  } else if (!(out.mirror_lead >= kMinMirrorLead) && out.returned < kMinReturned * out.restarts) {
    say(ImageVerdict::kAmbiguous, "only " + returned + ", and its mirror image explains the other image better (by " +
                                      number(-out.mirror_lead, 2) +
                                      "): a pose that is wrong, or left and right exchanged in one of the two");
  } else if (!(out.mirror_lead >= kMinMirrorLead)) {
    say(ImageVerdict::kAmbiguous, "its mirror image explains the other image better (by " +
                                      number(-out.mirror_lead, 2) +
                                      "): are left and right exchanged in one of the two, by a header or an export?");
  } else if (!options.affine && std::abs(out.stretch) > kMaxStretch && out.stretch_gain > kMinStretchGain) {
    say(ImageVerdict::kAmbiguous, "the head of the floating image is " + number(100.0 * std::abs(out.stretch), 0) +
                                      " % " + (out.stretch > 0.0 ? "larger" : "smaller") + " along " +
                                      direction_text(out.stretch_axis) +
                                      ": a wrong spacing in one of the headers, or another patient?");
  } else if (out.returned < kMinReturned * out.restarts) {
    say(ImageVerdict::kAmbiguous, "only " + returned);
  } else if (!(predicted <= kMaxError_mm)) {
    say(ImageVerdict::kAmbiguous, "the predicted error of " + number(predicted, 1) + " mm rms at " +
                                      number(kArm_mm, 0) + " mm from the centre is too large: a direction is free");
  } else if (finds_wrong_poses(options.measure)) {
    say(ImageVerdict::kAmbiguous, "this measure has found wrong poses of heads: it is there for comparison; register "
                                  "with another one");
  } else {
    say(ImageVerdict::kFound, {});
  }
}

} // namespace bregma::intensity
