#include "clients/cli/case/case_consistency.hpp"

#include <algorithm>
#include <cctype>
#include <optional>

#include <Eigen/Core>

#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/surface/surface_model.hpp"
#include "casefile/volumes/label_names.hpp"
#include "casefile/volumes/second_image.hpp"
#include "casefile/volumes/surface.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {
namespace {

using casefile::Case;
using casefile::NamedPoint;
using casefile::Surface;
using Eigen::Vector3d;

// Volumes of heads as they are imaged, from a child's without neck to a large one's with it, and of brains.
struct Range {
  double least_ml, most_ml;
};
constexpr Range kHead{1'500.0, 6'500.0};
constexpr Range kBrain{600.0, 2'200.0};
constexpr double kLeastBrainShare = 0.2, kMostBrainShare = 0.65; // of the head
constexpr double kMostOutside = 0.02;                            // fraction of the brain's surface outside of the scalp
constexpr double kLeastInBrain = 0.8;                            // fraction of a structure's surface inside the brain's
constexpr double kBrainTolerance_mm = 3.0;                       // both surfaces are smoothed
constexpr double kLeastInSecondImage = 0.4;                      // fraction of the scalp in a second image's grid
constexpr double kLeastSpread_mm =
    5.0; // of the fiducials, RMS from their best line, as the estimator (RegistrationOptions)
constexpr double kLongestPath_mm = 150.0;
// An entry is on the skin, the skull or the brain's surface: below that of the brain, or without one of the scalp.
constexpr double kDeepestInBrain_mm = 10.0, kDeepestInHead_mm = 40.0;
constexpr std::size_t kSamples = 500;
constexpr std::size_t kChecks = 3; // of a verification, verification.min_checks of the daemon

// Fraction of a mesh's vertices inside a surface, with a tolerance outwards.
double share_inside(const surface::TriangleMesh &mesh, const surface::SurfaceModel &surface, double tolerance_mm) {
  const std::size_t step = std::max<std::size_t>(1, mesh.vertices_mm.size() / kSamples);
  std::size_t inside = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); i += step, ++count) {
    inside += surface.closest(mesh.vertices_mm[i]).signed_mm <= tolerance_mm ? 1 : 0;
  }
  return static_cast<double>(inside) / static_cast<double>(std::max<std::size_t>(count, 1));
}

Vector3d centre_of(const surface::TriangleMesh &mesh) {
  Vector3d sum = Vector3d::Zero();
  for (const Vector3d &vertex : mesh.vertices_mm) {
    sum += vertex;
  }
  return sum / static_cast<double>(std::max<std::size_t>(mesh.vertices_mm.size(), 1));
}

std::string percent(double share) { return fixed(100.0 * share, 0) + " %"; }

class Consistency {
public:
  explicit Consistency(const Case &c) : c_(c), scalp_(c.scalp.mesh) {
    if (!c.brain.mesh.triangles.empty()) {
      brain_.emplace(c.brain.mesh);
    }
  }

  std::vector<std::string> find() {
    volumes();
    brain_in_head();
    structures();
    sides();
    fiducials();
    points();
    paths();
    images();
    missing();
    return std::move(out_);
  }

private:
  void say(const std::string &sentence) { out_.push_back(sentence); }

  void volume(const Surface &surface, double ml, const Range &range, const char *what) {
    if (!(ml >= range.least_ml && ml <= range.most_ml)) {
      say("the " + surface.name + " encloses " + fixed(ml, 0) + " ml, " + what + " has " + fixed(range.least_ml, 0) +
          " to " + fixed(range.most_ml, 0) + ": is it the whole surface of one, in mm?");
    }
  }

  void volumes() {
    const double head_ml = casefile::check_mesh(c_.scalp.mesh).volume_ml;
    volume(c_.scalp, head_ml, kHead, "a human head");
    if (!brain_) {
      return;
    }
    const double brain_ml = casefile::check_mesh(c_.brain.mesh).volume_ml;
    volume(c_.brain, brain_ml, kBrain, "a human brain");
    const double share = brain_ml / head_ml;
    if (!(share >= kLeastBrainShare && share <= kMostBrainShare)) {
      say("the brain fills " + percent(share) + " of the scalp's volume, " + percent(kLeastBrainShare) + " to " +
          percent(kMostBrainShare) + " are usual: are both of one person?");
    }
  }

  void brain_in_head() {
    if (!brain_) {
      return;
    }
    const double outside = 1.0 - share_inside(c_.brain.mesh, scalp_, 0.0);
    if (outside > kMostOutside) {
      say(percent(outside) + " of the brain's surface lie outside of the scalp: are both of one image?");
    }
  }

  void structures() {
    const surface::SurfaceModel &around = brain_ ? *brain_ : scalp_;
    for (const Surface &structure : c_.structures) {
      const double inside = share_inside(structure.mesh, around, brain_ ? kBrainTolerance_mm : 0.0);
      if (inside < kLeastInBrain) {
        say("only " + percent(inside) + " of the surface of \"" + structure.name + "\" lie in the " +
            (brain_ ? "brain" : "head"));
      }
    }
  }

  // Names such as "Precentral_L", "left M1" against the side of the brain's middle, without one of the head's.
  void sides() {
    const double middle = centre_of(brain_ ? c_.brain.mesh : c_.scalp.mesh).x();
    std::vector<std::string> wrong;
    std::size_t sided = 0;
    for (const Surface &structure : c_.structures) {
      const auto side = casefile::side_named(structure.name);
      if (!side) {
        continue;
      }
      ++sided;
      if ((centre_of(structure.mesh).x() > middle) == (*side == casefile::Side::kLeft)) {
        wrong.push_back(structure.name);
      }
    }
    if (wrong.empty()) {
      return;
    }
    std::string names;
    for (const std::string &name : wrong) {
      names += (names.empty() ? "\"" : ", \"") + name + "\"";
    }
    say(names + (wrong.size() == 1 ? " lies" : " lie") + " on the other side than the name says" +
        (wrong.size() == sided && sided > 1 ? ": are the labels mirrored?" : ""));
  }

  // The turn about a line through them would not be known; a registration refuses touches as near to one.
  void fiducials() {
    std::vector<Vector3d> points;
    for (const NamedPoint &fiducial : c_.fiducials) {
      points.push_back(fiducial.position_mm);
    }
    const Vector3d spread = registration::spread_mm(points);
    if (!(spread[1] >= kLeastSpread_mm)) {
      say("the fiducials lie on a line, or together, within " + fixed(spread[1], 1) +
          " mm (RMS): spread them over the head");
    }
  }

  void points() {
    for (const NamedPoint &target : c_.targets) {
      if (scalp_.closest(target.position_mm).signed_mm > 0.0) {
        say("target \"" + target.name + "\" lies outside of the scalp");
      }
    }
    for (const NamedPoint &landmark : c_.brain_landmarks) { // a case that has them has a brain
      if (const double off = brain_->closest(landmark.position_mm).signed_mm; off > kBrainTolerance_mm) {
        say("brain landmark \"" + landmark.name + "\" lies " + fixed(off, 1) + " mm outside of the brain");
      }
    }
  }

  void paths() {
    for (const casefile::Trajectory &path : c_.trajectories) {
      const std::string name = "trajectory \"" + path.name + "\"";
      const double length = (path.target_mm - path.entry_mm).norm();
      const double entry = scalp_.closest(path.entry_mm).signed_mm;
      const double target = scalp_.closest(path.target_mm).signed_mm;
      if (target > 0.0) {
        say(name + " ends outside of the scalp");
      } else if (entry < target) {
        say(name + " begins deeper in the head than it ends: are entry and target exchanged?");
      } else if (const double deep = brain_ ? -brain_->closest(path.entry_mm).signed_mm : -entry;
                 deep > (brain_ ? kDeepestInBrain_mm : kDeepestInHead_mm)) {
        say(name + " begins " + fixed(deep, 0) + " mm deep in the " + (brain_ ? "brain" : "head") +
            ": its entry is a point of the skin or of the brain's surface");
      }
      if (length > kLongestPath_mm) {
        say(name + " is " + fixed(length, 0) + " mm long: a probe reaches " + fixed(kLongestPath_mm, 0) + " mm");
      }
    }
  }

  void images() {
    for (const casefile::RegisteredImage &image : c_.images) {
      if (image.file.empty()) {
        continue;
      }
      const auto volume = casefile::read_volume(image.file);
      if (!volume) {
        say(volume.error().message);
        continue;
      }
      if (const double covered = casefile::covered_fraction(c_.scalp.mesh, *volume, image);
          covered < kLeastInSecondImage) {
        say("image \"" + image.name + "\" contains " + percent(covered) +
            " of the head's surface where its registration places it: is the transform that of this image?");
      }
    }
  }

  void missing() {
    if (c_.landmarks.size() < kChecks) {
      say("there are " + std::to_string(c_.landmarks.size()) + " landmarks, a verification checks " +
          std::to_string(kChecks) + " (verification.min_checks)");
    }
    if (c_.targets.empty()) {
      say("there is no target: the accuracy is predicted at targets");
    }
  }

  const Case &c_;
  surface::SurfaceModel scalp_;
  std::optional<surface::SurfaceModel> brain_;
  std::vector<std::string> out_;
};

} // namespace

std::vector<std::string> find_inconsistencies(const Case &c) { return Consistency(c).find(); }

} // namespace bregma::cli
