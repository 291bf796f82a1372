// Tables in text files, as people, spreadsheets and other programs write them: cells between commas, semicolons, tabs
// or blanks, with or without a header, quotes, a byte order mark, CRLF, UTF-16, decimal commas, plus signs and trailing
// separators.
//
// Only the text is read here. What a column means, and whether one is unknown, is the caller's: casefile/point_table.
// Errors name the file, the line and the cell. Nothing throws but std::bad_alloc.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.hpp"

namespace bregma::base {

struct CsvRow {
  int line = 0;                   // in the file, from 1
  std::vector<std::string> cells; // trimmed, without quotes; as many as the row has
};

struct CsvComment {
  int line = 0;
  std::string text; // trimmed, without #
};

struct CsvTable {
  std::string file;
  std::vector<CsvRow> rows; // without comments (#) and empty lines; a header is one of them
  std::vector<CsvComment> comments;
  bool ends = true; // false: the last line has no line end, and ends in a digit or a decimal point: more may be missing
  bool decimal_comma_stated = false; // commas are no separators, or no number in quotes has a point

  // The number of a cell. 1.5, +1.5, 1.5e3, and 1,5 where a comma cannot be anything else; nullopt for other text.
  // A comma before exactly three digits, in a table that also has decimal points, may group thousands: no number.
  [[nodiscard]] std::optional<double> number(std::string_view cell) const;
  // "file:line: "
  [[nodiscard]] std::string place(const CsvRow &row) const;
};

// The text of a file in UTF-8: UTF-16 with a byte order mark is converted, a mark of UTF-8 is removed.
[[nodiscard]] Result<std::string> utf8_of(const std::filesystem::path &file, std::string bytes);

// The cells of one line, separated like a table of that line alone; nullopt: a quote is not closed.
[[nodiscard]] std::optional<std::vector<std::string>> csv_cells(std::string_view line);

// Refuses a file that cannot be read, text that is not UTF-8 or UTF-16, and quotes that are not closed.
[[nodiscard]] Result<CsvTable> read_csv(const std::filesystem::path &file);

} // namespace bregma::base
