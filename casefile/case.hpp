// A case on disk: a folder with case.toml, the image, surfaces (PLY), and plans (Slicer .mrk.json).
// All data in memory are RAS, mm, in the frame of the image ("Image"); files are in LPS where their format requires it.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/geometry/pose_covariance.hpp"
#include "algorithms/surface/triangle_mesh.hpp"
#include "base/result.hpp"
#include "casefile/robot_tools.hpp"

namespace bregma::casefile {

struct NamedPoint {
  std::string name; // at most wire::kNameLength bytes, unique in its list
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  // Name of the registered image in which it was placed, as the file states it; empty: the planning image. A case that
  // was loaded has position_mm in Image in either case.
  std::string placed_in = {};
  // In Image: the error of that image's registration at the point. Zero for the planning image.
  Eigen::Matrix3d placing_covariance_mm2 = Eigen::Matrix3d::Zero();
};

struct Trajectory {
  std::string name;
  Eigen::Vector3d entry_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d target_mm = Eigen::Vector3d::Zero();
  std::string entry_in = {}, target_in = {}; // as NamedPoint::placed_in
};

// Another image of the same head, registered to the planning image, or a segmentation whose registration alone is kept.
struct RegisteredImage {
  std::string name;
  std::filesystem::path file; // empty: only the registration is kept
  // Maps its points to Image; the covariance is that of the registration (docs/images.md).
  geometry::UncertainPose<geometry::frame::Image, geometry::frame::Source> T_image_source;
  std::string measure;         // by which it was registered; may be empty
  std::string verdict;         // "found", "ambiguous", "refused" or "unknown"
  std::string accepted;        // why a person accepts a verdict other than found, in words
  std::string date;            // of the registration, ISO 8601; may be empty
  std::string sha256;          // of the file, in hexadecimal; empty without a file
  std::string planning_sha256; // of the planning image when it was registered
};

enum class ToolRole { kReference, kPointer, kProbe };

struct ToolModel {
  std::string name;
  ToolRole role = ToolRole::kPointer;
  // In the tool's body frame; at least three, not collinear. Empty: of a tracker without markers, which states the
  // covariance of each pose.
  std::vector<Eigen::Vector3d> markers_mm;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();        // direction that the markers face, in the body frame
  Eigen::Vector3d axis = -Eigen::Vector3d::UnitX();         // from the body towards the tip
  double axis_sigma_rad = 0.0;                              // error of the axis about the tip, 1 sigma; 0: not stated
  Eigen::Vector3d nominal_tip_mm = Eigen::Vector3d::Zero(); // as manufactured; navigation needs a calibrated tip
};

struct Surface {
  std::string name;
  surface::TriangleMesh mesh;
  std::string segmented_in = {}; // the registered image from which it was made; the mesh is in Image in either case
};

// Limits for accepting a registration, and for confirming a check.
struct Limits {
  double fle_image_mm = 0.5;      // 1-sigma per coordinate: error of the fiducials' positions in the image
  double fle_touch_mm = 0.3;      // 1-sigma per coordinate: placement error of a touch, in addition to the tracker's
  double surface_sigma_mm = 0.7;  // 1-sigma: skin compression and segmentation, along the normal
  double landmark_sigma_mm = 0.5; // 1-sigma per coordinate: error of the check landmarks' positions in the image
  double max_check_mm = 3.0;      // a larger error of a check touch cannot be confirmed
  double max_target_tre_mm = 2.0; // predicted RMS TRE above which a registration is not accepted
};

// The opening in the skull, where the brain is free. The centre is moved to the brain's surface.
struct CraniotomyPlan {
  std::string trajectory; // its entry into the brain is the centre; empty: centre_mm is used
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero(); // at most 30 mm from the brain's surface
  std::optional<double> radius_mm;                     // 0: the skull is closed; empty: as configured in the program
};

// Material of the brain for the tissue model: by name, with values that this case replaces.
struct TissueChoice {
  std::string material; // one of tissue::named_materials()
  std::optional<double> young_Pa, poisson, density_kg_m3;
  std::optional<double> ogden_alpha; // only for materials of Ogden's law
};

// Regions of the head as an image of their numbers, and a table of their names and colours (volumes/label_regions.hpp).
// Displays draw it; nothing is computed from it.
struct LabelImage {
  std::filesystem::path file;
  std::filesystem::path table;
};

// An arm that registers and navigates. Without hand-eye (equipment.hand_eye) there is no tracker: the patient is
// registered in the arm's base, the tool kRobotBase with the role of the reference, and the case's other tools are
// those that the arm carries. With it the reference is a body that the tracker beside the arm sees, as in a case
// without an arm, and the arm's tools follow the tracked ones in the list.
inline constexpr const char *kRobotBase = "RobotBase";
struct CaseRobot {
  std::string device; // as RobotState::device
  std::filesystem::path equipment_file;
  RobotEquipment equipment;
};

struct Case {
  std::filesystem::path folder;
  std::string id; // contains nothing about the patient
  std::filesystem::path image;
  std::optional<LabelImage> labels;
  Surface scalp;
  Surface brain;                       // without triangles: the case has none, and there is no tissue model
  std::vector<Surface> structures;     // critical structures
  std::vector<RegisteredImage> images; // without the planning image
  std::vector<NamedPoint> fiducials;
  std::vector<NamedPoint> landmarks;       // for checks, never part of the registration
  std::vector<NamedPoint> brain_landmarks; // anatomical points that the tissue model follows; never touched
  std::vector<NamedPoint> targets;
  std::vector<Trajectory> trajectories;
  std::vector<ToolModel> tools;
  Limits limits;
  std::optional<CraniotomyPlan> craniotomy;
  std::optional<TissueChoice> tissue;
  std::optional<CaseRobot> robot;

  // A tracker beside the arm; nullptr: none, or the case has no arm.
  [[nodiscard]] const HandEyeModel *hand_eye() const {
    return robot && robot->equipment.hand_eye ? &*robot->equipment.hand_eye : nullptr;
  }
  // Nothing measures whether the patient moves: there is an arm without a tracker.
  [[nodiscard]] bool arm_alone() const { return robot && !robot->equipment.hand_eye; }
  [[nodiscard]] bool carried_by_arm(std::string_view tool) const;
  [[nodiscard]] const ToolModel *tool(std::string_view name) const;
  [[nodiscard]] const ToolModel *reference() const;
  [[nodiscard]] const Trajectory *trajectory(std::string_view name) const;
  [[nodiscard]] const NamedPoint *fiducial(std::string_view name) const;
  [[nodiscard]] const NamedPoint *landmark(std::string_view name) const;
  [[nodiscard]] const RegisteredImage *registered_image(std::string_view name) const;
};

// Moves a point or a line from the image in which it was placed to Image, a point with its covariance. To be called
// once, for positions as they are in their file. One of an image that the case does not have is left as it is:
// check_case refuses it.
void map_to_image(const Case &c, NamedPoint &point);
void map_to_image(const Case &c, Trajectory &trajectory);

// Adds an image, or replaces that of the same name: points that were placed in it move with the new registration.
void put_image(Case &c, RegisteredImage image);

// Reads the whole folder; the result is the first error. kIgnore: also a case of which an image has changed since it
// was registered, for registering or removing that image; never for navigation.
enum class Checksums { kCompare, kIgnore };
[[nodiscard]] base::Result<Case> load_case(const std::filesystem::path &folder,
                                           Checksums checksums = Checksums::kCompare);

// The tables [[images]] alone, of a case that can be loaded: for clients that need no surfaces.
[[nodiscard]] base::Result<std::vector<RegisteredImage>> load_images(const std::filesystem::path &folder);

// The [[tools]] of a TOML file that contains nothing else, in the format of case.toml. check_case checks that they form
// a valid set.
[[nodiscard]] base::Result<std::vector<ToolModel>> read_tools(const std::filesystem::path &file);

// Writes the whole folder except the images: surfaces, plans, and then case.toml. c.image is stored relative to the
// folder if it is inside; c.labels as well. Existing files of these names are replaced; sessions/ is not changed.
[[nodiscard]] base::Result<void> save_case(const Case &c);

// The checks of load_case, for a case made in memory; the message contains the case's id.
[[nodiscard]] base::Result<void> check_case(const Case &c);

} // namespace bregma::casefile
