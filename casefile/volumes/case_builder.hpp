// Makes a case folder from image files and plans, for `bregma case create`.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "casefile/volumes/structures.hpp"

namespace bregma::casefile {

// The craniotomy of a case with a brain is centred on the first trajectory, if there is one.
struct CaseSources {
  std::string id;
  std::filesystem::path image;               // image of the head: a file or a DICOM folder
  std::string series;                        // series of the DICOM folder, if it has several
  std::optional<Space> space = std::nullopt; // of images that do not state theirs
  std::filesystem::path brain;               // the same head without skull: every voxel above 0 is brain; may be empty
  std::filesystem::path labels;              // of the same head, as in Segmentation; may be empty
  std::filesystem::path label_names;
  std::vector<StructureRequest> structures;
  // Slicer markups; all but the first may be empty. Landmarks in the brain need a brain.
  std::filesystem::path fiducials, landmarks, brain_landmarks, targets, trajectories;
  std::filesystem::path tools;           // TOML with [[tools]]
  int vertices = 10'000;                 // number for scalp and brain; structures get at most half
  std::optional<double> scalp_threshold; // Otsu's where not given
  bool anonymous = false;                // keeps nothing about the patient (patient.hpp)
  bool snap = false;                     // moves fiducials and landmarks onto the scalp, from at most kMaxSnap_mm
};

inline constexpr double kMaxSnap_mm = 10.0;

struct CreatedCase {
  Case value;
  std::vector<SurfaceSummary> surfaces; // scalp, brain where there is one, structures
  bool has_patient = false;             // patient.json was written
  std::vector<std::string> notes;       // what the files do not state and was assumed, or was left out
};

// Makes `folder` completely or not at all: it is written next to it under a hidden name and then renamed. An existing
// folder is replaced only if `replace` is set and it has a case.toml; its sessions/ are kept. Blocks for some seconds.
[[nodiscard]] base::Result<CreatedCase> create_case(const std::filesystem::path &folder, const CaseSources &sources,
                                                    bool replace, const Progress &progress = {});

struct SnappedPoint {
  std::string name;
  double moved_mm = 0.0;
};

// Moves the points to the nearest position on the surface. A point farther away than max_mm is refused and named.
[[nodiscard]] base::Result<std::vector<SnappedPoint>> snap_points(std::vector<NamedPoint> &points,
                                                                  const Surface &surface, double max_mm);

} // namespace bregma::casefile
