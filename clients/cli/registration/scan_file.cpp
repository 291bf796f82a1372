#include "clients/cli/registration/scan_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include <nlohmann/json.hpp>

#include "base/csv_table.hpp"
#include "base/read_file.hpp"
#include "base/text.hpp"

namespace bregma::cli {

namespace {

using nlohmann::json;

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
constexpr double kMaxDamagedFraction = 0.1;
constexpr double kMaxPosition_mm = 1e5; // of an arm: beyond it the line was garbled
constexpr std::size_t kMaxCurveBytes = std::size_t{1} << 20;

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

base::Result<range::PowerLawFit> read_range_curve(const std::filesystem::path &file) {
  const auto text = base::read_file(file, kMaxCurveBytes);
  if (!text) {
    return tl::unexpected(text.error());
  }
  const json document = json::parse(*text, nullptr, false);
  const auto number = [&document](const char *key) -> std::optional<double> {
    const auto found = document.is_object() ? document.find(key) : document.end();
    return found != document.end() && found->is_number() ? std::optional(found->get<double>()) : std::nullopt;
  };
  const auto scale = number("scale_mm");
  const auto exponent = number("exponent");
  if (!scale || !exponent || !(*scale > 0.0) || !std::isfinite(*scale) || !std::isfinite(*exponent) ||
      *exponent == 0.0) {
    return base::failure(file.string() +
                         ": holds no curve (scale_mm, exponent): use what calibrate range --json prints");
  }
  if (const auto accepted = document.find("accepted");
      accepted == document.end() || !accepted->is_boolean() || !accepted->get<bool>()) {
    return base::failure(file.string() + ": this curve was not accepted by its calibration");
  }
  range::PowerLawFit out;
  out.estimated = true;
  out.verdict = range::PowerLawVerdict::kAccepted;
  out.law = {*scale, *exponent};
  const auto covariance = document.find("covariance");
  if (covariance != document.end() && covariance->is_array() && covariance->size() == 2) {
    for (std::size_t r = 0; r < 2; ++r) {
      const json &row = (*covariance)[r];
      if (!row.is_array() || row.size() != 2 || !row[0].is_number() || !row[1].is_number()) {
        return base::failure(file.string() + ": covariance: must be two rows of two numbers");
      }
      out.covariance.row(static_cast<Eigen::Index>(r)) << row[0].get<double>(), row[1].get<double>();
    }
  }
  // A curve of an earlier version has neither misfit nor corrections.
  out.rms_mm = number("rms_mm").value_or(0.0);
  out.corrected_rms_mm = number("corrected_rms_mm").value_or(out.rms_mm);
  if (const auto corrections = document.find("corrections"); corrections != document.end()) {
    for (const json &row : *corrections) {
      const bool whole = row.is_object() && row.contains("reading") && row["reading"].is_number() &&
                         row.contains("add_mm") && row["add_mm"].is_number();
      if (!whole || (!out.corrections.empty() && !(out.corrections.back().reading < row["reading"].get<double>()))) {
        return base::failure(file.string() + ": corrections: must hold reading and add_mm, with increasing readings");
      }
      out.corrections.push_back({row["reading"].get<double>(), row["add_mm"].get<double>()});
    }
  }
  return out;
}

} // namespace bregma::cli
