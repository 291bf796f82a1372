// Tables of points in text files (base/csv_table.hpp): what their columns mean.
//
// With a header the columns are read by name, in any order and case, perhaps with a unit ("x [cm]", "x_mm"):
//   x y z, pos_x pos_y pos_z in the space that the caller states, otherwise RAS is assumed, and said
//   r a s   l p s            any letter of each pair: R or L, A or P, S or I; also as words: left, posterior, superior
//   name, label; id          name of the point; id only if there is none of the others
//   curve                    curve that the point belongs to
//   sigma   sx sy sz         1 sigma of every coordinate, or of each
//   cxx cxy cxz cyy cyz czz  covariance
//   t                        ANTs: the space is LPS; t itself is not used
//   defined                  Slicer: 0 if the point was never placed
//   selected visible locked description ...  of Slicer and ANTs: not used, and said
// A comment may name the columns ("# x y z") and state space and unit ("# CoordinateSystem = LPS", "# units: cm").
// Any other column is refused by name. A row is a header only if it names columns and contains no number.
// Without a header: x,y,z or name,x,y,z, perhaps followed by sx,sy,sz or the covariance; or SimNIBS' rows
// type,x,y,z,name, with type Fiducial, Electrode, ReferenceElectrode or Generic.
//
// Errors name file, line, point and value.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/result.hpp"
#include "casefile/length_unit.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

struct TablePoint {
  std::string name;                                             // "3" for the third point of a table without names
  std::string curve;                                            // empty: the table has no such column
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();        // RAS, finite
  std::optional<Eigen::Matrix3d> covariance_mm2 = std::nullopt; // RAS, positive definite
};

struct PointTable {
  std::vector<TablePoint> points; // all with a covariance, or none
  bool named = false;             // the names are those of the file
  std::vector<std::string> notes; // sentences: what was assumed, left out or not used
};

struct PointTableOptions {
  std::optional<Space> space = std::nullopt; // of columns x y z; a header that states its space has priority
  LengthUnit unit = LengthUnit::kMillimetre; // a header that states its unit has priority
  bool curves = false;                       // without a header, the first of four cells is the curve
};

// By the extension, in any case: .csv, .tsv or .txt.
[[nodiscard]] bool is_point_table(const std::filesystem::path &file);

[[nodiscard]] base::Result<PointTable> read_point_table(const std::filesystem::path &file,
                                                        const PointTableOptions &options = {});

} // namespace bregma::casefile
