#include "clients/cli/registration/scan_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include "base/csv_table.hpp"
#include "base/text.hpp"

namespace bregma::cli {

namespace {

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
constexpr double kMaxDamagedFraction = 0.1;
constexpr double kMaxPosition_mm = 1e5; // of an arm: beyond it the line was garbled

struct ScanColumns {
  std::array<std::size_t, 3> at{0, 1, 2}; // x, y, reading
  std::size_t count = 3;
  bool distances = false;
};

// Empty: not the header of a scan. A header contains no number.
base::Result<std::optional<ScanColumns>> header_of(const base::CsvTable &table, const base::CsvRow &row) {
  constexpr std::array<std::pair<std::string_view, std::size_t>, 8> kWords{{{"x", 0},
                                                                            {"x_mm", 0},
                                                                            {"y", 1},
                                                                            {"y_mm", 1},
                                                                            {"reading", 2},
                                                                            {"distance_mm", 2},
                                                                            {"distance", 2},
                                                                            {"range_mm", 2}}};
  const auto word_of = [&kWords](const std::string &cell) {
    return std::find_if(kWords.begin(), kWords.end(),
                        [lower = base::lower(cell)](const auto &w) { return w.first == lower; });
  };
  const bool numbers = std::any_of(row.cells.begin(), row.cells.end(),
                                   [&table](const std::string &cell) { return table.number(cell).has_value(); });
  const bool words = std::any_of(row.cells.begin(), row.cells.end(),
                                 [&](const std::string &cell) { return word_of(cell) != kWords.end(); });
  if (numbers || !words) {
    return std::nullopt;
  }
  constexpr std::size_t kAbsent = std::numeric_limits<std::size_t>::max();
  ScanColumns out{{kAbsent, kAbsent, kAbsent}, row.cells.size(), false};
  for (std::size_t i = 0; i < row.cells.size(); ++i) {
    const auto word = word_of(row.cells[i]);
    if (word == kWords.end()) {
      return base::failure(table.place(row) + "column \"" + row.cells[i] +
                           "\" is not known; known are x, y, x_mm, y_mm, reading, distance_mm");
    }
    if (out.at[word->second] != kAbsent) {
      return base::failure(table.place(row) + "the columns \"" + row.cells[out.at[word->second]] + "\" and \"" +
                           row.cells[i] + "\" mean the same");
    }
    out.at[word->second] = i;
    out.distances = out.distances || (word->second == 2 && word->first != "reading");
  }
  for (const auto &[column, names] : {std::pair(0, "x"), {1, "y"}, {2, "reading or distance_mm"}}) {
    if (out.at[static_cast<std::size_t>(column)] == kAbsent) {
      return base::failure(table.place(row) + "has no column " + names);
    }
  }
  return out;
}

bool is_missing(std::string_view cell) {
  const std::string lower = base::lower(cell);
  return lower.empty() || lower == "nan" || lower == "-nan" || lower == "na" || lower == "-";
}

// damaged: where a position or a reading is no value that robot or sensor can have.
range::ScanRecord record_of(const base::CsvTable &table, const base::CsvRow &row, const ScanColumns &columns,
                            double modulo, bool &damaged) {
  range::ScanRecord out{kNothing, kNothing, kNothing};
  if (row.cells.size() != columns.count) {
    damaged = true; // which cells are left is not known
    return out;
  }
  const auto position = [&](std::size_t column) {
    const auto value = table.number(row.cells[columns.at[column]]);
    const bool valid = value && std::abs(*value) < kMaxPosition_mm; // false for NaN
    damaged = damaged || !valid;
    return valid ? *value : kNothing;
  };
  out.x_mm = position(0);
  out.y_mm = position(1);
  const std::string &cell = row.cells[columns.at[2]];
  if (!is_missing(cell)) {
    const auto value = table.number(cell);
    if (value && std::isfinite(*value) && *value >= 0.0) {
      out.reading = modulo > 0.0 ? std::fmod(*value, modulo) : *value;
    } else {
      damaged = true;
    }
  }
  return out;
}

} // namespace

base::Result<ScanFile> read_scan_file(const std::filesystem::path &file, double modulo) {
  const auto table = base::read_csv(file);
  if (!table) {
    return tl::unexpected(table.error());
  }
  std::span<const base::CsvRow> rows(table->rows);
  ScanColumns columns;
  if (!rows.empty()) {
    const auto header = header_of(*table, rows.front());
    if (!header) {
      return tl::unexpected(header.error());
    }
    if (*header) {
      columns = **header;
      rows = rows.subspan(1);
    }
  }
  if (rows.empty()) {
    return base::failure(file.string() + ": holds no records");
  }
  ScanFile out;
  out.distances = columns.distances;
  out.records.reserve(rows.size());
  std::string first_damaged;
  for (const base::CsvRow &row : rows) {
    bool damaged = false;
    out.records.push_back(record_of(*table, row, columns, modulo, damaged));
    out.damaged += damaged ? 1 : 0;
    if (damaged && first_damaged.empty()) {
      first_damaged = table->place(row);
    }
  }
  const auto fraction = static_cast<double>(out.damaged) / static_cast<double>(out.records.size());
  if (fraction > kMaxDamagedFraction) {
    return base::failure(first_damaged + std::to_string(out.damaged) + " of " + std::to_string(out.records.size()) +
                         " rows are not x, y and a reading, this is the first: at most a tenth may be damaged");
  }
  if (out.damaged > 0) {
    out.notes.push_back(first_damaged + "the first of " + std::to_string(out.damaged) +
                        " damaged rows: what they lack counts as missing");
  }
  return out;
}

} // namespace bregma::cli
