#include "clients/cli/point_file.hpp"

#include <cmath>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>

#include "casefile/markups.hpp"
#include "casefile/text.hpp"

namespace bregma::cli {

namespace {

using casefile::failure;
using casefile::NamedPoint;
using casefile::Result;

std::vector<std::string> cells_of(const std::string &line) {
  std::vector<std::string> out;
  for (std::string_view cell : casefile::cells(line, ',')) {
    const bool quoted = cell.size() > 1 && cell.front() == '"' && cell.back() == '"';
    out.emplace_back(quoted ? casefile::trimmed(cell.substr(1, cell.size() - 2)) : cell);
  }
  return out;
}

// Only words: nothing that could be a point.
bool is_header(const std::vector<std::string> &cells) {
  for (const std::string &cell : cells) {
    if (casefile::parsed_number<double>(cell)) {
      return false;
    }
  }
  return true;
}

Result<std::vector<NamedPoint>> read_csv(const std::filesystem::path &file) {
  std::error_code error;
  std::ifstream in(file);
  if (!in || std::filesystem::is_directory(file, error)) {
    return failure(file.string() + ": no such file, or it cannot be read");
  }
  std::vector<NamedPoint> out;
  bool header_allowed = true;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::string place = file.string() + ":" + std::to_string(number) + ": ";
    const std::vector<std::string> cells = cells_of(line);
    if (casefile::trimmed(line).empty() || line.starts_with("#")) {
      continue;
    }
    if (std::exchange(header_allowed, false) && is_header(cells)) {
      continue;
    }
    if (cells.size() != 3 && cells.size() != 4) {
      return failure(place + "must be \"name,x,y,z\" or \"x,y,z\", this line has " + std::to_string(cells.size()) +
                     " cells");
    }
    NamedPoint point;
    const std::size_t offset = cells.size() - 3;
    point.name = offset == 1 ? cells[0] : std::to_string(out.size() + 1);
    for (std::size_t i = 0; i < 3; ++i) {
      const auto value = casefile::parsed_number<double>(cells[offset + i]);
      if (!value || !std::isfinite(*value)) {
        return failure(place + "point " + point.name + ": " + std::string(1, static_cast<char>('x' + i)) + " = \"" +
                       cells[offset + i] + "\": must be a finite number");
      }
      point.position_mm[static_cast<Eigen::Index>(i)] = *value;
    }
    out.push_back(std::move(point));
  }
  return out;
}

} // namespace

Result<std::vector<NamedPoint>> read_point_file(const std::filesystem::path &file) {
  const std::string name = file.filename().string();
  if (name.ends_with(".csv")) {
    return read_csv(file);
  }
  if (name.ends_with(".json") || name.ends_with(".fcsv")) {
    return casefile::read_points(file);
  }
  return failure(file.string() + ": is neither .csv nor .mrk.json nor .fcsv");
}

} // namespace bregma::cli
