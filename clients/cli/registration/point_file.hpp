// Lists of points in files: .csv (x,y,z or name,x,y,z, with or without a header line), .mrk.json and .fcsv.
//
// Behind the position a .csv file may state the point's error: sx,sy,sz, 1 sigma a coordinate, or
// cxx,cxy,cxz,cyy,cyz,czz, its covariance. Slicer's files say whether they are LPS or RAS and come out as RAS; a .csv
// file is taken as it is unless the caller says that it is LPS.
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
  std::vector<Eigen::Matrix3d> covariances; // mm^2, one a point, positive definite; empty where the file states none
};

struct PointFileOptions {
  std::optional<casefile::Space> space = std::nullopt; // of a .csv file
  casefile::LengthUnit unit = casefile::LengthUnit::kMillimetre;
  casefile::SizeLimits size = casefile::kPointsSize; // not looked at where there is only one point
  std::string unit_option = "another unit";          // what a refused width advises
};

// Errors name the file, the line and the value. The file may hold no points.
[[nodiscard]] base::Result<PointFile> read_point_file(const std::filesystem::path &file,
                                                      const PointFileOptions &options = {});

} // namespace bregma::cli
