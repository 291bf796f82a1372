// What the columns of a table of points mean: by a header, by a comment, or by their number (casefile/point_table.hpp).
//
// Errors name file, line and column. Pure, any thread.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/csv_table.hpp"
#include "base/result.hpp"
#include "casefile/length_unit.hpp"
#include "casefile/point_table.hpp"
#include "casefile/space.hpp"

namespace bregma::casefile::detail {

enum class Meaning {
  kX,
  kY,
  kZ,
  kName,
  kId,
  kCurve,
  kSigma,
  kSigmaX,
  kSigmaY,
  kSigmaZ,
  kCxx,
  kCxy,
  kCxz,
  kCyy,
  kCyz,
  kCzz,
  kTime,
  kDefined,
  kNotUsed
};

// What a header's word says about a column: axis and sign are those of RAS.
struct Column {
  Meaning meaning = Meaning::kNotUsed;
  double sign = 1.0;
  bool space_stated = false;
  std::optional<LengthUnit> unit = std::nullopt;
  std::string word; // as in the file
};

// Position of each meaning in a row.
class Layout {
public:
  Layout(std::vector<Column> columns, std::string place) : columns_(std::move(columns)), place_(std::move(place)) {}

  // Each meaning once, and three coordinates. unstated: the unit where no column states it.
  [[nodiscard]] base::Result<void> check(LengthUnit unstated);
  // A space that comments state against one of the columns.
  [[nodiscard]] base::Result<void> check_space(Space stated) const;

  [[nodiscard]] bool has(Meaning meaning) const { return at_.contains(meaning); }
  [[nodiscard]] std::size_t at(Meaning meaning) const { return at_.at(meaning); }
  [[nodiscard]] const std::vector<Column> &columns() const { return columns_; }
  [[nodiscard]] bool space_stated() const { return columns_[at_.at(Meaning::kX)].space_stated; }
  [[nodiscard]] std::optional<LengthUnit> unit() const { return columns_[at_.at(Meaning::kX)].unit; }

private:
  // The coordinates have one unit, and their errors the same where they state one.
  [[nodiscard]] base::Result<void> check_units(LengthUnit unstated) const;

  std::vector<Column> columns_;
  std::string place_; // "file:line: "
  std::map<Meaning, std::size_t> at_;
};

// The header of the table: its first row, or a comment. is_first_row: the points begin behind it.
struct PointHeader {
  std::optional<base::CsvRow> row;
  bool is_first_row = false;
};
[[nodiscard]] PointHeader point_header(const base::CsvTable &table);

// "# CoordinateSystem = LPS", "# units: cm", as other formats state them. A value that is not known is an error: what
// is stated must not be passed over.
struct Statements {
  std::optional<Space> space;
  std::optional<LengthUnit> unit;
};
[[nodiscard]] base::Result<Statements> statements_of(const base::CsvTable &table);

// Without a header by the number of columns. options: with what the comments state.
[[nodiscard]] base::Result<Layout> layout_of(const base::CsvTable &table, const PointHeader &header,
                                             const PointTableOptions &options);
// What was assumed about the columns, and which are not used.
[[nodiscard]] std::vector<std::string> notes_of(const base::CsvTable &table, const Layout &layout,
                                                const PointHeader &header, const PointTableOptions &options);

} // namespace bregma::casefile::detail
