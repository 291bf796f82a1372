#include "casefile/point_columns.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <span>
#include <string_view>

#include "base/text.hpp"
#include "casefile/markup_notes.hpp"

namespace bregma::casefile::detail {
namespace {

using base::CsvRow;
using base::CsvTable;

struct KnownWord {
  std::string_view word;
  Meaning meaning;
  double sign = 1.0;
  bool space_stated = false;
};

constexpr auto kWords = std::to_array<KnownWord>({
    {"x", Meaning::kX},
    {"y", Meaning::kY},
    {"z", Meaning::kZ},
    {"pos_x", Meaning::kX},
    {"pos_y", Meaning::kY},
    {"pos_z", Meaning::kZ},
    {"right", Meaning::kX, 1.0, true},
    {"anterior", Meaning::kY, 1.0, true},
    {"superior", Meaning::kZ, 1.0, true},
    {"left", Meaning::kX, -1.0, true},
    {"posterior", Meaning::kY, -1.0, true},
    {"inferior", Meaning::kZ, -1.0, true},
    {"r", Meaning::kX, 1.0, true},
    {"a", Meaning::kY, 1.0, true},
    {"s", Meaning::kZ, 1.0, true},
    {"l", Meaning::kX, -1.0, true},
    {"p", Meaning::kY, -1.0, true},
    {"i", Meaning::kZ, -1.0, true},
    {"name", Meaning::kName},
    {"label", Meaning::kName},
    {"point", Meaning::kName},
    {"id", Meaning::kId},
    {"curve", Meaning::kCurve},
    {"sigma", Meaning::kSigma},
    {"sx", Meaning::kSigmaX},
    {"sy", Meaning::kSigmaY},
    {"sz", Meaning::kSigmaZ},
    {"cxx", Meaning::kCxx},
    {"cxy", Meaning::kCxy},
    {"cxz", Meaning::kCxz},
    {"cyy", Meaning::kCyy},
    {"cyz", Meaning::kCyz},
    {"czz", Meaning::kCzz},
    {"t", Meaning::kTime},
    {"defined", Meaning::kDefined},
    {"selected", Meaning::kNotUsed},
    {"visible", Meaning::kNotUsed},
    {"locked", Meaning::kNotUsed},
    {"description", Meaning::kNotUsed},
    {"desc", Meaning::kNotUsed},
    {"comment", Meaning::kNotUsed},
    {"associatednodeid", Meaning::kNotUsed},
    {"mass", Meaning::kNotUsed},
    {"volume", Meaning::kNotUsed},
    {"count", Meaning::kNotUsed},
    {"type", Meaning::kNotUsed},
    {"index", Meaning::kNotUsed},
});

// "x [cm]", "x (cm)", "x_cm": the word and the unit.
std::pair<std::string, std::optional<LengthUnit>> split_unit(const std::string &word) {
  const auto open = word.find_first_of("[(_");
  if (open == std::string::npos || open == 0) {
    return {word, std::nullopt};
  }
  std::string_view unit = std::string_view(word).substr(open + 1);
  if (word[open] != '_' && !unit.empty()) {
    unit.remove_suffix(1);
  }
  const auto known = unit_named(base::trimmed(unit));
  return known ? std::pair(std::string(base::trimmed(std::string_view(word).substr(0, open))), known)
               : std::pair(word, std::optional<LengthUnit>());
}

std::optional<Column> column_named(const std::string &cell) {
  const auto [word, unit] = split_unit(base::lower(cell));
  const auto known =
      std::find_if(kWords.begin(), kWords.end(), [&w = word](const KnownWord &one) { return one.word == w; });
  if (known == kWords.end()) {
    return std::nullopt;
  }
  return Column{known->meaning, known->sign, known->space_stated, unit, cell};
}

// A header names at least one column and contains no number.
bool is_header(const CsvTable &table, const CsvRow &row) {
  bool names = false;
  for (const std::string &cell : row.cells) {
    if (table.number(cell)) {
      return false;
    }
    names = names || column_named(cell).has_value();
  }
  return names;
}

// "# x y z", as numpy writes it: a comment that names the three coordinates, between separators or in as many words as
// a row has cells. Prose is no header.
std::optional<CsvRow> header_in_comments(const CsvTable &table) {
  for (const base::CsvComment &comment : table.comments) {
    const std::string_view text = comment.text;
    const std::size_t equals = text.find('=');
    const bool labelled =
        equals != std::string_view::npos && base::lower(base::trimmed(text.substr(0, equals))) == "columns"; // as .fcsv
    auto cells = base::csv_cells(labelled ? text.substr(equals + 1) : text);
    if (!cells || cells->size() < 3) {
      continue;
    }
    std::set<Meaning> coordinates;
    std::size_t known = 0;
    for (const std::string &cell : *cells) {
      const auto column = column_named(cell);
      known += column ? 1 : 0;
      if (column && column->meaning <= Meaning::kZ) {
        coordinates.insert(column->meaning);
      }
    }
    const bool separated = comment.text.find_first_of(",;\t") != std::string::npos;
    const bool as_wide = !table.rows.empty() && table.rows.front().cells.size() == cells->size();
    if (known == cells->size() || (coordinates.size() == 3 && (separated || as_wide))) {
      return CsvRow{comment.line, std::move(*cells)};
    }
  }
  return std::nullopt;
}

constexpr const char *kWithoutHeader =
    "without a header a row is x,y,z or name,x,y,z, and may go on with sx,sy,sz or cxx,cxy,cxz,cyy,cyz,czz";

std::vector<Column> plain_columns(std::span<const Meaning> meanings) {
  std::vector<Column> out;
  constexpr std::array<const char *, 3> kAxes{"x", "y", "z"};
  for (const Meaning meaning : meanings) {
    const auto known =
        std::find_if(kWords.begin(), kWords.end(), [meaning](const KnownWord &one) { return one.meaning == meaning; });
    out.push_back(
        {.meaning = meaning,
         .word = meaning <= Meaning::kZ ? kAxes[static_cast<std::size_t>(meaning)] : std::string(known->word)});
  }
  return out;
}

// Columns of a table without a header, from the number of its cells. Empty: not one of these.
std::vector<Column> columns_by_count(const CsvRow &first, const PointTableOptions &options) {
  using enum Meaning;
  std::vector<Meaning> out{kX, kY, kZ};
  std::size_t cells = first.cells.size();
  constexpr std::array<std::string_view, 4> kSimNibs{"fiducial", "electrode", "referenceelectrode", "generic"};
  if (cells == 5 && std::find(kSimNibs.begin(), kSimNibs.end(), base::lower(first.cells[0])) != kSimNibs.end()) {
    return plain_columns(std::array{kNotUsed, kX, kY, kZ, kName});
  }
  if (cells % 3 == 1) {
    out.insert(out.begin(), options.curves ? kCurve : kName);
    --cells;
  }
  if (cells == 6) {
    out.insert(out.end(), {kSigmaX, kSigmaY, kSigmaZ});
  } else if (cells == 9) {
    out.insert(out.end(), {kCxx, kCxy, kCxz, kCyy, kCyz, kCzz});
  } else if (cells != 3) {
    return {};
  }
  return plain_columns(out);
}

std::string list_of(const std::vector<std::string> &words) {
  std::string out;
  for (const std::string &word : words) {
    out += (out.empty() ? "" : ", ") + word;
  }
  return out;
}

// Columns without a header that are something else than their number suggests.
base::Result<void> check_columns_by_count(const CsvTable &table, const std::vector<Column> &columns) {
  const auto is_whole = [&table](const std::string &cell) {
    const auto value = table.number(cell);
    return value && *value == std::floor(*value) && cell.find_first_of(".,eE") == std::string::npos;
  };
  bool any_decimals = false;
  for (const CsvRow &row : table.rows) {
    const auto value = table.number(row.cells.front());
    if (columns.front().meaning == Meaning::kName && value && !is_whole(row.cells.front())) {
      return base::failure(table.place(row) + "\"" + row.cells.front() +
                           "\" is no name: " + std::to_string(columns.size()) +
                           " numbers need a header that says what they are; " + kWithoutHeader);
    }
    any_decimals = any_decimals || std::any_of(row.cells.begin(), row.cells.end(), [&](const std::string &cell) {
                     return table.number(cell) && !is_whole(cell);
                   });
  }
  const bool pairs = std::count_if(columns.begin(), columns.end(), [](const Column &column) {
                       return column.meaning >= Meaning::kSigmaX && column.meaning <= Meaning::kSigmaZ;
                     }) == 3;
  return pairs && !any_decimals
             ? base::failure(table.place(table.rows.front()) +
                             "has whole numbers where x,y,z and their errors are expected: are its commas decimal "
                             "commas? With them, separate by semicolons or tabs, or add a header")
             : base::Result<void>();
}

} // namespace

base::Result<void> Layout::check(LengthUnit unstated) {
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    const Column &column = columns_[i];
    if (column.meaning == Meaning::kNotUsed) {
      continue;
    }
    if (const auto [at, fresh] = at_.try_emplace(column.meaning, i); !fresh) {
      return base::failure(place_ + "the columns \"" + columns_[at->second].word + "\" and \"" + column.word +
                           "\" mean the same");
    }
  }
  for (const auto &[meaning, names] :
       {std::pair(Meaning::kX, "x, r or l"), {Meaning::kY, "y, a or p"}, {Meaning::kZ, "z, s or i"}}) {
    if (!has(meaning)) {
      return base::failure(place_ + "has no column " + names);
    }
  }
  const auto stated = [this](Meaning meaning) { return columns_[at_.at(meaning)].space_stated; };
  if (stated(Meaning::kX) != stated(Meaning::kY) || stated(Meaning::kX) != stated(Meaning::kZ)) {
    return base::failure(place_ + "mixes columns x, y, z with columns that state their direction");
  }
  return check_units(unstated);
}

base::Result<void> Layout::check_space(Space stated) const {
  const double sign = stated == Space::kLps ? -1.0 : 1.0;
  const auto differs = [&](Meaning meaning, double wanted) {
    const Column &column = columns_[at_.at(meaning)];
    return column.space_stated && column.sign != wanted;
  };
  return differs(Meaning::kX, sign) || differs(Meaning::kY, sign) || differs(Meaning::kZ, 1.0) ||
                 (has(Meaning::kTime) && stated == Space::kRas)
             ? base::failure(place_ + "its columns contradict the coordinate system that a comment states")
             : base::Result<void>();
}

base::Result<void> Layout::check_units(LengthUnit unstated) const {
  for (const Column &column : columns_) {
    const bool coordinate = column.meaning <= Meaning::kZ;
    const bool error = column.meaning >= Meaning::kSigma && column.meaning <= Meaning::kCzz;
    if ((coordinate && column.unit != unit()) || (error && column.unit && *column.unit != unit().value_or(unstated))) {
      return base::failure(place_ + "column \"" + column.word + "\" has another unit than \"" +
                           columns_[at_.at(Meaning::kX)].word + "\"");
    }
  }
  return {};
}

PointHeader point_header(const CsvTable &table) {
  if (!table.rows.empty() && is_header(table, table.rows.front())) {
    return {table.rows.front(), true};
  }
  return {header_in_comments(table)};
}

base::Result<Statements> statements_of(const CsvTable &table) {
  Statements out;
  for (const base::CsvComment &comment : table.comments) {
    const std::size_t at = comment.text.find_first_of("=:");
    if (at == std::string::npos) {
      continue;
    }
    std::string key = base::lower(base::trimmed(std::string_view(comment.text).substr(0, at)));
    std::erase_if(key, [](char c) { return c == ' ' || c == '_' || c == '-'; });
    const std::string value(base::trimmed(std::string_view(comment.text).substr(at + 1)));
    const auto refuse = [&](const std::string &what) {
      return base::failure(table.file + ":" + std::to_string(comment.line) + ": " + comment.text.substr(0, 80) + ": " +
                           what);
    };
    const bool is_lps = base::lower(value) == "lps";
    const auto space = is_lps || base::lower(value) == "ras" ? std::optional(is_lps ? Space::kLps : Space::kRas)
                                                             : space_of(value); // numbers as in .fcsv
    if (key == "coordinatesystem" || (key == "space" && space)) {
      if (!space || (out.space && out.space != space)) {
        return refuse(space ? "is stated before as another one" : "must be LPS or RAS");
      }
      out.space = space;
    } else if (key == "unit" || key == "units" || key == "coordinateunits" || key == "lengthunit") {
      const auto unit = unit_named(base::lower(value));
      if (!unit || (out.unit && out.unit != unit)) {
        return refuse(unit ? "is stated before as another one" : "must be mm, cm, m or um");
      }
      out.unit = unit;
    }
  }
  return out;
}

base::Result<Layout> layout_of(const CsvTable &table, const PointHeader &header, const PointTableOptions &options) {
  std::vector<Column> columns;
  if (header.row) {
    for (const std::string &cell : header.row->cells) {
      auto column = column_named(cell);
      if (!column) {
        return base::failure(table.place(*header.row) + "column \"" + cell +
                             "\" is not known; known are x y z, r a s, l p s, name, label, curve, sigma, sx sy sz and "
                             "the columns of Slicer and ANTs");
      }
      columns.push_back(std::move(*column));
    }
  } else if (!table.rows.empty()) {
    columns = columns_by_count(table.rows.front(), options);
    if (columns.empty()) {
      return base::failure(table.place(table.rows.front()) + "has " + std::to_string(table.rows.front().cells.size()) +
                           " cells: " + kWithoutHeader);
    }
    if (auto plausible = check_columns_by_count(table, columns); !plausible) {
      return tl::unexpected(plausible.error());
    }
  }
  Layout layout(std::move(columns), header.row ? table.place(*header.row) : table.file + ": ");
  if (auto checked = table.rows.empty() && !header.row ? base::Result<void>() : layout.check(options.unit); !checked) {
    return tl::unexpected(checked.error());
  }
  return layout;
}

std::vector<std::string> notes_of(const CsvTable &table, const Layout &layout, const PointHeader &header,
                                  const PointTableOptions &options) {
  std::vector<std::string> out;
  if (!header.row && layout.columns().size() > 4) {
    std::vector<std::string> words;
    for (const Column &column : layout.columns()) {
      words.push_back(column.word);
    }
    out.push_back(table.file + ": without a header its columns are taken as " + list_of(words));
  }
  std::vector<std::string> not_used;
  for (const Column &column : layout.columns()) {
    if (column.meaning == Meaning::kNotUsed || column.meaning == Meaning::kTime) {
      not_used.push_back(column.word);
    }
  }
  const bool times = layout.has(Meaning::kTime);
  if (times) {
    out.push_back(table.file + ": a column t is ANTs': LPS is read");
  } else if (!layout.space_stated() && !options.space) {
    out.push_back(table.file + ": the space of x, y, z is not stated: RAS is assumed");
  }
  const bool contradicts = options.space && (layout.space_stated() || (times && options.space == Space::kRas));
  if (contradicts) {
    out.push_back(table.file + ": its columns state their directions, which have priority over an option");
  }
  if (layout.unit() && *layout.unit() != options.unit && options.unit != LengthUnit::kMillimetre) {
    out.push_back(table.file + ": its columns state their unit, which has priority over an option");
  }
  if (!table.ends) {
    out.push_back(table.place(table.rows.back()) +
                  "the last line does not end: digits of its last number may be missing");
  }
  if (!not_used.empty()) {
    out.push_back(table.file + ": not used: column" + (not_used.size() > 1 ? "s " : " ") + list_of(not_used));
  }
  return out;
}

} // namespace bregma::casefile::detail
