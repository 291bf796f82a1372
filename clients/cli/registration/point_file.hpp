// Lists of points in files: .csv (x,y,z or name,x,y,z, with or without a header line), .mrk.json and .fcsv.
//
// After the position a .csv file may have the point's error: sx,sy,sz, 1 sigma per coordinate, or
// cxx,cxy,cxz,cyy,cyz,czz, its covariance. Slicer's files state LPS or RAS and are converted to RAS; a .csv file is not
// converted unless the caller states that it is LPS.
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
  std::vector<casefile::NamedPoint> points; // finite; mm
  std::vector<Eigen::Matrix3d> covariances; // mm^2, one per point, positive definite; empty if the file has none
};

struct PointFileOptions {
  std::optional<casefile::Space> space = std::nullopt; // space of a .csv file
  casefile::LengthUnit unit = casefile::LengthUnit::kMillimetre;
  casefile::SizeLimits size = casefile::kPointsSize; // not checked for a single point
  std::string unit_option = "another unit";          // advice in the message about a refused width
};

// Errors name the file, the line and the value. The file may be without points.
[[nodiscard]] base::Result<PointFile> read_point_file(const std::filesystem::path &file,
                                                      const PointFileOptions &options = {});

} // namespace bregma::cli
