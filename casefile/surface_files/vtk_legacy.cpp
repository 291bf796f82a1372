// VTK's legacy polydata, versions 1 to 5.1, ASCII and binary (big-endian).
//
// VTK's own reader is not used. If a section is truncated, VTK 9.1 prints a warning and returns points that it has not
// read, and it accepts corners beyond the last point.
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "casefile/surface_files/mesh_arrays.hpp"
#include "casefile/surface_files/number_bytes.hpp"
#include "casefile/surface_files/raw_surface.hpp"
#include "casefile/surface_files/text_cursor.hpp"

namespace bregma::casefile::detail {

namespace {

std::optional<NumberType> legacy_type(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, NumberType>, 13> kNames{{{"char", NumberType::kInt8},
                                                                            {"unsigned_char", NumberType::kUint8},
                                                                            {"short", NumberType::kInt16},
                                                                            {"unsigned_short", NumberType::kUint16},
                                                                            {"int", NumberType::kInt32},
                                                                            {"unsigned_int", NumberType::kUint32},
                                                                            {"long", NumberType::kInt64},
                                                                            {"unsigned_long", NumberType::kUint64},
                                                                            {"vtktypeint32", NumberType::kInt32},
                                                                            {"vtktypeint64", NumberType::kInt64},
                                                                            {"vtkIdType", NumberType::kInt64},
                                                                            {"float", NumberType::kFloat},
                                                                            {"double", NumberType::kDouble}}};
  for (const auto &[known, type] : kNames) {
    if (known == name) {
      return type;
    }
  }
  return std::nullopt;
}

class LegacyReader {
public:
  explicit LegacyReader(std::string_view content) : content_(content), cursor_(content) {}

  Parsed<RawSurface> read() {
    static_cast<void>(cursor_.rest_of_line()); // "# vtk DataFile Version 4.2"
    const auto space = stated_space(cursor_.rest_of_line());
    if (!space) {
      return tl::unexpected(space.error());
    }
    surface_.space = *space;
    surface_.format = "VTK";
    const std::string_view encoding = cursor_.word();
    if (encoding != "ASCII" && encoding != "BINARY") {
      return wrong_line(cursor_.line(), in_quotes(encoding) + " where ASCII or BINARY is expected");
    }
    binary_ = encoding == "BINARY";
    if (const auto word = cursor_.word(); word != "DATASET") {
      return wrong_line(cursor_.line(), in_quotes(word) + " where DATASET is expected");
    }
    if (const auto kind = cursor_.word(); kind != "POLYDATA") {
      return wrong_line(cursor_.line(), "the dataset is " + in_quotes(kind) + ", only POLYDATA is read");
    }
    static_cast<void>(cursor_.rest_of_line());
    while (!done_) {
      if (auto section = read_section(); !section) {
        Problem problem = section.error();
        if (binary_ && !problem.byte) { // binary data has no lines
          problem.line = 0;
          problem.byte = cursor_.position();
        }
        return tl::unexpected(problem);
      }
    }
    // The format states the size of each section, but not which sections there are.
    surface_.notes.push_back(read_counts(surface_.mesh));
    if (!binary_) {
      note_open_end(content_, surface_);
    }
    return std::move(surface_);
  }

private:
  Parsed<void> read_section() {
    const std::string_view keyword = cursor_.word();
    // Point and cell data comes last and is not needed.
    if (keyword.empty() || keyword == "POINT_DATA" || keyword == "CELL_DATA") {
      done_ = true;
      return {};
    }
    if (keyword == "METADATA") {
      static_cast<void>(cursor_.rest_of_line());
      while (cursor_.left() > 0 && !cursor_.rest_of_line().empty()) { // metadata ends with an empty line
      }
      return {};
    }
    if (keyword == "POINTS") {
      return read_points();
    }
    if (keyword == "FIELD") {
      return read_field();
    }
    if (keyword == "POLYGONS" || keyword == "TRIANGLE_STRIPS") {
      return read_cells(keyword == "POLYGONS" ? Cells::kPolygons : Cells::kStrips);
    }
    if (keyword == "VERTICES" || keyword == "LINES") {
      return read_cells(std::nullopt);
    }
    return wrong_line(cursor_.line(), in_quotes(keyword) + " is not a section of polydata");
  }

  // The next `count` numbers, in either encoding.
  Parsed<std::vector<double>> numbers(std::size_t count, NumberType type, const std::string &what) {
    std::vector<double> out;
    if (binary_) {
      const std::size_t size = size_of(type);
      const std::size_t start = cursor_.position();
      if (cursor_.left() / size < count) {
        return wrong_byte(content_.size(), "the file ends before " + what + " does");
      }
      out.reserve(count);
      for (std::size_t i = 0; i < count; ++i) {
        out.push_back(load_number(content_.data() + start + i * size, type, true));
      }
      cursor_.skip_to(start + count * size);
      return out;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const auto value = cursor_.number(what + ": number " + std::to_string(i));
      if (!value) {
        return tl::unexpected(value.error());
      }
      out.push_back(*value);
    }
    return out;
  }

  Parsed<NumberType> type() {
    const std::string_view name = cursor_.word();
    const auto known = legacy_type(name);
    if (!known) {
      return wrong_line(cursor_.line(), "type " + in_quotes(name) + " is not one of numbers");
    }
    static_cast<void>(cursor_.rest_of_line());
    return *known;
  }

  Parsed<void> read_points() {
    const auto count = cursor_.count("number of points", 1);
    const auto kind = count ? type() : tl::unexpected(count.error());
    const auto values = kind ? numbers(3 * *count, *kind, "POINTS") : tl::unexpected(kind.error());
    if (!values) {
      return tl::unexpected(values.error());
    }
    const std::string problem = append_vertices(surface_.mesh, *values);
    return problem.empty() ? Parsed<void>() : wrong_line(cursor_.line(), problem);
  }

  // FIELD name n, then n times: name components tuples type, numbers.
  Parsed<void> read_field() {
    static_cast<void>(cursor_.word());
    const auto arrays = cursor_.count("number of arrays", 1);
    if (!arrays) {
      return tl::unexpected(arrays.error());
    }
    for (std::size_t i = 0; i < *arrays; ++i) {
      static_cast<void>(cursor_.word());
      const auto components = cursor_.count("number of components", 1);
      const auto tuples = components ? cursor_.count("number of tuples", 1) : components;
      const auto kind = tuples ? type() : tl::unexpected(tuples.error());
      const auto values = kind ? numbers(*components * *tuples, *kind, "FIELD") : tl::unexpected(kind.error());
      if (!values) {
        return tl::unexpected(values.error());
      }
    }
    return {};
  }

  // "POLYGONS cells numbers", then the number of corners and the corners of each cell. Since version 5:
  // "POLYGONS offsets corners" with OFFSETS and CONNECTIVITY. kind: empty for cells that are no part of a surface.
  Parsed<void> read_cells(std::optional<Cells> kind) {
    const int line = cursor_.line();
    const auto cells = cursor_.count("number of cells", 1);
    const auto size = cells ? cursor_.count("number of corners", 1) : cells;
    if (!size) {
      return tl::unexpected(size.error());
    }
    static_cast<void>(cursor_.rest_of_line());
    const std::size_t start = cursor_.position();
    if (content_.substr(start).starts_with("OFFSETS")) {
      static_cast<void>(cursor_.word());
      const auto offset_type = type();
      const auto offsets = offset_type ? numbers(*cells, *offset_type, "OFFSETS") : tl::unexpected(offset_type.error());
      if (!offsets) {
        return tl::unexpected(offsets.error());
      }
      if (const auto word = cursor_.word(); word != "CONNECTIVITY") {
        return wrong_line(cursor_.line(), in_quotes(word) + " where CONNECTIVITY is expected");
      }
      const auto corner_type = type();
      const auto corners =
          corner_type ? numbers(*size, *corner_type, "CONNECTIVITY") : tl::unexpected(corner_type.error());
      if (!corners) {
        return tl::unexpected(corners.error());
      }
      if (!offsets->empty() && offsets->front() != 0.0) {
        return wrong_line(line, "OFFSETS must begin with 0");
      }
      const std::span<const double> ends(*offsets);
      return kind ? keep(*kind, *corners, ends.subspan(ends.empty() ? 0 : 1), line) : Parsed<void>();
    }
    const auto values = numbers(*size, NumberType::kInt32, "POLYGONS");
    if (!values) {
      return tl::unexpected(values.error());
    }
    std::vector<double> corners;
    std::vector<double> ends;
    for (std::size_t at = 0; kind && ends.size() < *cells;) {
      const double count = at < values->size() ? (*values)[at] : 0.0;
      if (!(count >= 1.0 && count <= static_cast<double>(values->size() - at - 1))) {
        return wrong_line(line, "cell " + std::to_string(ends.size()) + " ends after the section does");
      }
      const auto first = values->begin() + static_cast<std::ptrdiff_t>(at) + 1;
      corners.insert(corners.end(), first, first + static_cast<std::ptrdiff_t>(count));
      ends.push_back(static_cast<double>(corners.size()));
      at += static_cast<std::size_t>(count) + 1;
    }
    return kind ? keep(*kind, corners, ends, line) : Parsed<void>();
  }

  Parsed<void> keep(Cells kind, std::span<const double> corners, std::span<const double> ends, int line) {
    const std::string problem = append_cells(surface_.mesh, kind, corners, ends);
    return problem.empty() ? Parsed<void>() : wrong_line(line, problem);
  }

  std::string_view content_;
  TextCursor cursor_;
  RawSurface surface_;
  bool binary_ = false;
  bool done_ = false;
};

} // namespace

Parsed<RawSurface> parse_vtk_legacy(std::string_view content) { return LegacyReader(content).read(); }

} // namespace bregma::casefile::detail
