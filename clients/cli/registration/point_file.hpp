// Lists of points that are given on the command line.
#pragma once

#include <filesystem>
#include <vector>

#include "casefile/case.hpp"
#include "casefile/result.hpp"

namespace bregma::cli {

// Slicer's .mrk.json and .fcsv (converted to RAS), or .csv: "name,x,y,z" or "x,y,z" a line, in mm and in whatever frame
// the file means. Blank lines, lines that start with '#' and one header line are skipped. Errors name file, line,
// value.
[[nodiscard]] casefile::Result<std::vector<casefile::NamedPoint>> read_point_file(const std::filesystem::path &file);

} // namespace bregma::cli
