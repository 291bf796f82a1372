// A case on disk: a folder with case.toml, the image, surfaces (PLY), and plans (Slicer .mrk.json).
// Everything in memory is RAS, mm, in the frame of the image ("Image"); files say LPS where their format does.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/surface/triangle_mesh.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

struct NamedPoint {
  std::string name; // at most wire::kNameLength bytes, unique in its list
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
};

struct Trajectory {
  std::string name;
  Eigen::Vector3d entry_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d target_mm = Eigen::Vector3d::Zero();
};

enum class ToolRole { kReference, kPointer, kProbe };

struct ToolModel {
  std::string name;
  ToolRole role = ToolRole::kPointer;
  std::vector<Eigen::Vector3d> markers_mm;                  // in the tool's body frame; at least three, not collinear
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();        // direction that the markers face, in the body frame
  Eigen::Vector3d axis = -Eigen::Vector3d::UnitX();         // from the body towards the tip
  Eigen::Vector3d nominal_tip_mm = Eigen::Vector3d::Zero(); // as manufactured; navigation needs a calibrated tip
};

struct Surface {
  std::string name;
  surface::TriangleMesh mesh;
};

// Limits that a registration has to keep before it can be accepted, and a check before it can be confirmed.
struct Limits {
  double fle_image_mm = 0.5;      // 1-sigma a coordinate: with what error fiducials were placed in the image
  double fle_touch_mm = 0.3;      // 1-sigma a coordinate: placement error of a touch, beside the tracker's
  double surface_sigma_mm = 0.7;  // 1-sigma: skin give and segmentation, along the normal
  double landmark_sigma_mm = 0.5; // 1-sigma a coordinate: with what error check landmarks were placed in the image
  double max_check_mm = 3.0;      // a check touch beyond it cannot be confirmed
  double max_target_tre_mm = 2.0; // predicted RMS TRE above which a registration is not accepted
};

// Where the skull is open, so that the brain is free there. The centre is taken to the brain's surface.
struct CraniotomyPlan {
  std::string trajectory;                              // its way into the brain is the centre; empty: centre_mm is
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero(); // at most 30 mm from the brain's surface
  std::optional<double> radius_mm;                     // 0: the skull is closed; nothing: as the program is configured
};

// What the tissue model takes the brain for: a material by its name, and what this case knows better.
struct TissueChoice {
  std::string material; // of tissue::named_materials()
  std::optional<double> young_Pa, poisson, density_kg_m3;
  std::optional<double> ogden_alpha; // only of materials that have one
};

struct Case {
  std::filesystem::path folder;
  std::string id; // patient-free
  std::filesystem::path image;
  Surface scalp;
  Surface brain;
  std::vector<Surface> structures; // critical ones: never to be touched
  std::vector<NamedPoint> fiducials;
  std::vector<NamedPoint> landmarks;       // for checks, never part of the registration
  std::vector<NamedPoint> brain_landmarks; // anatomical, followed by the tissue model; nobody touches them
  std::vector<NamedPoint> targets;
  std::vector<Trajectory> trajectories;
  std::vector<ToolModel> tools;
  Limits limits;
  std::optional<CraniotomyPlan> craniotomy;
  std::optional<TissueChoice> tissue;

  [[nodiscard]] const ToolModel *tool(std::string_view name) const;
  [[nodiscard]] const ToolModel *reference() const;
  [[nodiscard]] const Trajectory *trajectory(std::string_view name) const;
  [[nodiscard]] const NamedPoint *fiducial(std::string_view name) const;
  [[nodiscard]] const NamedPoint *landmark(std::string_view name) const;
};

// Reads the folder whole; the first thing that is wrong is the error.
[[nodiscard]] base::Result<Case> load_case(const std::filesystem::path &folder);

// The [[tools]] of a TOML file, as case.toml has them, with nothing else in it. Whether they make a set is for
// check_case.
[[nodiscard]] base::Result<std::vector<ToolModel>> read_tools(const std::filesystem::path &file);

// Writes the whole folder but the image: surfaces, plans and case.toml, the last one last. c.image is taken relative to
// the folder where it lies inside. Existing files of these names are replaced; sessions/ is left alone.
[[nodiscard]] base::Result<void> save_case(const Case &c);

// The checks that load_case makes on what was read, with the case's id in the message: for a case made in memory.
[[nodiscard]] base::Result<void> check_case(const Case &c);

} // namespace bregma::casefile
