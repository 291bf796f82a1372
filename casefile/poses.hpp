// Recorded tool poses: folders or .tgz archives of 4x4 matrices, and the headers of PLUS sequence files
// (.igs.mha, .igs.mhd, .igs.nrrd).
//
// Transforms have PLUS's names: "StylusToReference" maps points of Stylus into Reference (mm), that is
// T_reference_stylus. Errors name the file, the line and the frame.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/geometry/rigid3.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

using NamedRigid = geometry::Rigid3<geometry::frame::Target, geometry::frame::Source>;

struct TimedPose {
  std::int64_t time_ns = 0; // by the recording's own clock
  NamedRigid pose;
};

struct PoseSeries {
  std::string transform;        // its name; empty where the file has none
  std::vector<TimedPose> poses; // valid ones, in the order of time
  std::size_t invalid = 0;      // frames that the tracker marked as invalid
};

// One .txt file per pose: four rows of four numbers; the file's name is the time in ns. A folder, or an archive (tar
// with any common compression, or zip) of such files. Other files are ignored.
[[nodiscard]] base::Result<PoseSeries> read_pose_matrices(const std::filesystem::path &folder_or_archive);

struct SequenceFrame {
  std::int64_t time_ns = 0; // since the start of the recording's clock
  struct Entry {
    NamedRigid pose;
    bool valid = false; // status OK; a frame without status is not valid
  };
  std::map<std::string, Entry, std::less<>> transforms; // by name, for example "StylusToTracker"
};

struct TransformSequence {
  std::filesystem::path file;
  std::vector<SequenceFrame> frames;

  [[nodiscard]] std::vector<std::string> names() const;
  // A recorded transform, its inverse, or a chain of them ("StylusToReference" from StylusToTracker and
  // ReferenceToTracker of the same frame). A frame counts as invalid when any link is.
  [[nodiscard]] base::Result<PoseSeries> series(std::string_view name) const;
};

[[nodiscard]] base::Result<TransformSequence> read_transform_sequence(const std::filesystem::path &file);

// Either kind, depending on the path. transform is needed only for sequence files.
[[nodiscard]] base::Result<PoseSeries> read_poses(const std::filesystem::path &path, std::string_view transform = {});

} // namespace bregma::casefile
