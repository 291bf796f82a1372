// Points, lines and curves in the formats of 3D Slicer's Markups module: .mrk.json (read and written, schema 1.0) and
// .fcsv (read).
//
// In memory all positions are RAS, mm. Files state LPS or RAS, and their unit, and are converted; written files are LPS
// in mm, as Slicer writes them. A control point whose description is "image: NAME" was placed in the registered image
// of that name (NamedPoint::placed_in), and its position is in that image's coordinates. Errors name the file, the
// control point and the value.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "casefile/length_unit.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile {

struct Markup {
  enum class Kind { kPoints, kLine, kCurve, kClosedCurve };
  Kind kind = Kind::kPoints;
  std::string name;               // name of the list or line; may be empty
  std::vector<NamedPoint> points; // with the labels of the file, which may be empty; a line has two: entry, target
};

// A polyline through marked points. Slicer draws a smooth curve through them; here the marked points are joined by
// straight lines.
struct MarkedCurve {
  std::string name;
  std::vector<Eigen::Vector3d>
      points_mm; // two or more, neighbours apart; closed: three or more, the first not repeated
  bool closed = false;
};

// For what a file does not state; without them LPS for .mrk.json and RAS for .fcsv, as Slicer takes it, and mm. A .fcsv
// is always in mm.
struct MarkupDefaults {
  std::optional<Space> space = std::nullopt;
  std::optional<LengthUnit> unit = std::nullopt;
};

// What a reader left out: sentences that name the file. A reader without it (nullptr) refuses the file instead.
using Notes = std::vector<std::string>;

// Every markup of a file, in its order. Left out: points that were never placed, and kinds other than Fiducial, Line,
// Curve and ClosedCurve beside one of these.
[[nodiscard]] base::Result<std::vector<Markup>> read_markups(const std::filesystem::path &file, Notes *notes = nullptr,
                                                             const MarkupDefaults &defaults = {});

// The points of all lists of a file, in order. Left out: other kinds beside a list. Labels are not checked here, but by
// load_case.
[[nodiscard]] base::Result<std::vector<NamedPoint>>
read_points(const std::filesystem::path &file, Notes *notes = nullptr, const MarkupDefaults &defaults = {});

// Every line of a file: the first control point is the entry, the second the target. A line without a name gets that of
// its file. Left out: other kinds beside a line.
[[nodiscard]] base::Result<std::vector<Trajectory>> read_trajectories(const std::filesystem::path &file,
                                                                      Notes *notes = nullptr);

// The curves of a .mrk.json file (a line is one of two points), or of a table with a column curve (point_table.hpp):
// the rows of a name, which need not be neighbours, are its points in order; a curve whose last point is its first is
// closed. Names must differ. Left out of a .mrk.json file: other kinds beside a curve.
[[nodiscard]] base::Result<std::vector<MarkedCurve>> read_curves(const std::filesystem::path &file,
                                                                 Notes *notes = nullptr);

[[nodiscard]] base::Result<void> write_points(const std::filesystem::path &file, const std::string &list_name,
                                              std::span<const NamedPoint> points);
[[nodiscard]] base::Result<void> write_trajectories(const std::filesystem::path &file,
                                                    std::span<const Trajectory> trajectories);

} // namespace bregma::casefile
