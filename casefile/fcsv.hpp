// Slicer's older format of a list of points: comment lines with the coordinate system and the columns, then one point
// per line, in mm. Read by read_markups.
#pragma once

#include <filesystem>
#include <vector>

#include "base/result.hpp"
#include "casefile/markups.hpp"

namespace bregma::casefile {

// One list. Notes, defaults and errors are those of read_markups.
[[nodiscard]] base::Result<std::vector<Markup>> read_fcsv(const std::filesystem::path &file, Notes *notes,
                                                          const MarkupDefaults &defaults);

} // namespace bregma::casefile
