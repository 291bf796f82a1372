// Lists of points in files: tables (casefile/point_table.hpp), and Slicer's .mrk.json and .fcsv (casefile/markups.hpp).
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "casefile/length_unit.hpp"
#include "casefile/space.hpp"

namespace bregma::cli {

struct PointFile {
  std::vector<casefile::NamedPoint> points; // RAS, mm; finite
  std::vector<Eigen::Matrix3d> covariances; // mm^2, one per point, positive definite; empty if the file has none
  bool named = false;                       // the names are those of the file; otherwise numbers in its order
  std::vector<std::string> notes;           // what was assumed or left out
};

struct PointFileOptions {
  // Of a file that does not state its own. A .fcsv is always in mm.
  std::optional<casefile::Space> space = std::nullopt;
  casefile::LengthUnit unit = casefile::LengthUnit::kMillimetre;
  casefile::SizeLimits size = casefile::kPointsSize; // not checked for a single point
  std::string unit_option = "another unit";          // advice in the message about a refused width
};

// Errors name the file, the line and the value. The file may be without points.
[[nodiscard]] base::Result<PointFile> read_point_file(const std::filesystem::path &file,
                                                      const PointFileOptions &options = {});

} // namespace bregma::cli
