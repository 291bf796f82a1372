// Records of a scan with a range sensor, in a file: a table (base/csv_table.hpp) with one row per reading, in order:
// the robot's x and y in mm and the reading. A header may name the columns: x, y, x_mm, y_mm, reading; or distance_mm
// for a reading that is a distance. A reading is missing where its cell is empty, "NaN", "NA" or "-". Rows of a line
// that was cut off or garbled are kept as rows without a reading, so that the times of the others stay right, and are
// counted. A file with too many of them is refused.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "algorithms/range/surface_scan.hpp"
#include "base/result.hpp"

namespace bregma::cli {

struct ScanFile {
  std::vector<range::ScanRecord> records;
  bool distances = false; // the third column is a distance in mm
  std::size_t damaged = 0;
  std::vector<std::string> notes;
};
// modulo: readings are taken modulo this, which undoes two readings that the line joined; 0: as they are.
// Refused: no rows, an unknown column, not three columns, more than a tenth of the rows damaged.
[[nodiscard]] base::Result<ScanFile> read_scan_file(const std::filesystem::path &file, double modulo);

} // namespace bregma::cli
