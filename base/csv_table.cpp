#include "base/csv_table.hpp"

#include <algorithm>
#include <span>

#include "base/read_file.hpp"
#include "base/text.hpp"

namespace bregma::base {
namespace {

void append_utf8(std::string &out, char32_t code) {
  const auto byte = [&out](char32_t value) { out.push_back(static_cast<char>(static_cast<unsigned char>(value))); };
  if (code < 0x80) {
    byte(code);
  } else if (code < 0x800) {
    byte(0xC0 | (code >> 6));
    byte(0x80 | (code & 0x3F));
  } else if (code < 0x10000) {
    byte(0xE0 | (code >> 12));
    byte(0x80 | ((code >> 6) & 0x3F));
    byte(0x80 | (code & 0x3F));
  } else {
    byte(0xF0 | (code >> 18));
    byte(0x80 | ((code >> 12) & 0x3F));
    byte(0x80 | ((code >> 6) & 0x3F));
    byte(0x80 | (code & 0x3F));
  }
}

// bytes: after the byte order mark. nullopt: an odd number of bytes, or half of a surrogate pair.
std::optional<std::string> from_utf16(std::string_view bytes, bool big_endian) {
  if (bytes.size() % 2 != 0) {
    return std::nullopt;
  }
  const auto unit = [&](std::size_t i) {
    const auto first = static_cast<unsigned char>(bytes[2 * i]);
    const auto second = static_cast<unsigned char>(bytes[2 * i + 1]);
    return static_cast<char32_t>(big_endian ? first << 8 | second : second << 8 | first);
  };
  std::string out;
  for (std::size_t i = 0; i < bytes.size() / 2; ++i) {
    char32_t code = unit(i);
    if (code >= 0xD800 && code < 0xDC00 && 2 * i + 3 < bytes.size()) {
      const char32_t low = unit(++i);
      if (low < 0xDC00 || low > 0xDFFF) {
        return std::nullopt;
      }
      code = 0x10000 + ((code - 0xD800) << 10) + (low - 0xDC00);
    } else if (code >= 0xD800 && code <= 0xDFFF) {
      return std::nullopt;
    }
    append_utf8(out, code);
  }
  return out;
}

std::string_view without_plus(std::string_view text) {
  const bool plus = text.size() > 1 && text[0] == '+' && text[1] != '+' && text[1] != '-';
  return plus ? text.substr(1) : text;
}

bool has_outside_of_quotes(std::string_view line, char wanted) {
  bool quoted = false;
  return std::any_of(line.begin(), line.end(), [&](char c) {
    quoted = quoted != (c == '"');
    return !quoted && c == wanted;
  });
}

// "A 1,5 -2,0 3,5": every comma is within a number, of which blanks separate at least three. The first line may be a
// header, which has none.
bool has_decimal_commas_between_blanks(std::span<const std::string_view> lines) {
  bool any = false;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    std::size_t words = 0;
    std::size_t commas = 0;
    if (lines[i].find_first_of(";\t\"") != std::string_view::npos) {
      return false;
    }
    for (std::string_view rest = lines[i]; !rest.empty(); ++words) {
      const std::size_t end = std::min(rest.find(' '), rest.size());
      const std::string_view word = rest.substr(0, end);
      const std::size_t comma = word.find(',');
      if (comma != std::string_view::npos) {
        std::string with_point(without_plus(word));
        std::replace(with_point.begin(), with_point.end(), ',', '.');         // a second one is no number
        if (comma + 1 == word.size() || !parsed_number<double>(with_point)) { // "1, 2"
          return false;
        }
        ++commas;
      }
      rest.remove_prefix(std::min(rest.find_first_not_of(' ', end), rest.size()));
    }
    if (words < 3 || (commas == 0 && i > 0)) {
      return false;
    }
    any = any || commas > 0;
  }
  return any;
}

// The first of these that at least half of the lines contain. A semicolon or tab separates even if there are more
// commas: those are decimal.
char separator_of(std::span<const std::string_view> lines) {
  if (has_decimal_commas_between_blanks(lines)) {
    return ' ';
  }
  for (const char candidate : {';', '\t', ','}) {
    const auto with = std::count_if(lines.begin(), lines.end(), [candidate](std::string_view line) {
      return has_outside_of_quotes(line, candidate);
    });
    if (2 * with >= std::ssize(lines) && with > 0) {
      return candidate;
    }
  }
  return ' ';
}

// The cells of one line; nullopt: a quote is not closed. Quotes are doubled within a quoted cell.
std::optional<std::vector<std::string>> split(std::string_view line, char separator) {
  std::vector<std::string> out(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == '"') {
      if (quoted && i + 1 < line.size() && line[i + 1] == '"') {
        out.back().push_back(line[++i]);
      } else {
        quoted = !quoted;
      }
    } else if (!quoted && (c == separator || (separator == ' ' && c == '\t'))) {
      if (separator != ' ' || !out.back().empty()) { // blanks separate in any number
        out.emplace_back();
      }
    } else {
      out.back().push_back(c);
    }
  }
  if (quoted) {
    return std::nullopt;
  }
  for (std::string &cell : out) {
    cell = trimmed(cell);
  }
  while (separator == ' ' && out.size() > 1 && out.back().empty()) {
    out.pop_back();
  }
  return out;
}

bool is_digits(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
}

// A number with a point before its decimals.
bool has_point(std::string_view cell) {
  return cell.find('.') != std::string_view::npos && parsed_number<double>(without_plus(cell)).has_value();
}

// Numbers of spreadsheets have trailing separators where other rows have more cells.
void drop_empty_end(std::vector<CsvRow> &rows) {
  std::size_t width = 0;
  for (const CsvRow &row : rows) {
    std::size_t used = row.cells.size();
    while (used > 0 && row.cells[used - 1].empty()) {
      --used;
    }
    width = std::max(width, used);
  }
  for (CsvRow &row : rows) {
    row.cells.resize(std::min(row.cells.size(), width));
  }
}

} // namespace

std::optional<double> CsvTable::number(std::string_view cell) const {
  const std::string_view plain = without_plus(cell);
  if (const auto value = parsed_number<double>(plain)) {
    return value;
  }
  const auto comma = plain.find(',');
  if (comma == std::string_view::npos) {
    return std::nullopt;
  }
  const std::string_view decimals = plain.substr(comma + 1);
  const bool thousands = decimals.size() == 3 && is_digits(decimals) && !decimal_comma_stated;
  if (thousands || plain.find('.') != std::string_view::npos) {
    return std::nullopt;
  }
  std::string with_point(plain);
  with_point[comma] = '.';
  return parsed_number<double>(with_point); // a second comma is no number
}

std::string CsvTable::place(const CsvRow &row) const { return file + ":" + std::to_string(row.line) + ": "; }

Result<std::string> utf8_of(const std::filesystem::path &file, std::string bytes) {
  const std::string_view text(bytes);
  if (text.starts_with("\xEF\xBB\xBF")) {
    return bytes.substr(3);
  }
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF")) {
    auto converted = from_utf16(text.substr(2), text[0] == '\xFE');
    if (!converted) {
      return failure(file.string() + ": is not whole: its UTF-16 text ends within a character");
    }
    if (converted->find('\0') == std::string::npos) {
      return std::move(*converted);
    }
    return failure(file.string() + ": is not text (UTF-8, or UTF-16 with a byte order mark)");
  }
  if (text.find('\0') != std::string_view::npos) {
    return failure(file.string() + ": is not text (UTF-8, or UTF-16 with a byte order mark)");
  }
  return bytes;
}

std::optional<std::vector<std::string>> csv_cells(std::string_view line) {
  return split(line, separator_of({&line, 1}));
}

Result<CsvTable> read_csv(const std::filesystem::path &file) {
  auto bytes = read_file(file);
  if (!bytes) {
    return tl::unexpected(bytes.error());
  }
  const auto text = utf8_of(file, std::move(*bytes));
  if (!text) {
    return tl::unexpected(text.error());
  }
  CsvTable out;
  out.file = file.string();
  out.ends = text->empty() || (!is_digits(text->substr(text->size() - 1)) && text->back() != '.');
  std::vector<std::string_view> lines;
  std::vector<int> numbers;
  int number = 0;
  const char line_end = text->find('\n') == std::string::npos ? '\r' : '\n'; // spreadsheets of old write CR alone
  for (std::string_view rest = *text; !rest.empty();) {
    const std::size_t end = std::min(rest.find(line_end), rest.size());
    const std::string_view line = trimmed(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
    ++number;
    if (line.starts_with('#')) {
      out.comments.push_back({number, std::string(trimmed(line.substr(1)))});
    } else if (!line.empty()) {
      lines.push_back(line);
      numbers.push_back(number);
    }
  }
  const char separator = separator_of(lines);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    auto cells = split(lines[i], separator);
    if (!cells) {
      return failure(out.file + ":" + std::to_string(numbers[i]) + ": a quote is not closed");
    }
    // Spreadsheets write separators alone for rows below the last one.
    if (std::any_of(cells->begin(), cells->end(), [](const std::string &cell) { return !cell.empty(); })) {
      out.rows.push_back({numbers[i], std::move(*cells)});
    }
  }
  drop_empty_end(out.rows);
  const auto any_point = [](const CsvRow &row) { return std::any_of(row.cells.begin(), row.cells.end(), has_point); };
  out.decimal_comma_stated = separator != ',' || std::none_of(out.rows.begin(), out.rows.end(), any_point);
  return out;
}

} // namespace bregma::base
