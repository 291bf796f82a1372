#include "clients/cli/point_file.hpp"

#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <system_error>
#include <utility>

#include "casefile/markups.hpp"

namespace bregma::cli {

namespace {

using casefile::failure;
using casefile::NamedPoint;
using casefile::Result;

std::string trimmed(const std::string &text) {
  const auto first = text.find_first_not_of(" \t\r\"");
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(" \t\r\"") - first + 1);
}

std::optional<double> number_of(const std::string &text) {
  double value = 0.0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool number = !text.empty() && parsed.ec == std::errc() && parsed.ptr == text.data() + text.size();
  return number ? std::optional(value) : std::nullopt;
}

std::vector<std::string> cells_of(const std::string &line) {
  std::vector<std::string> out;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) {
    out.push_back(trimmed(cell));
  }
  return out;
}

// Only words: nothing that could be a point.
bool is_header(const std::vector<std::string> &cells) {
  for (const std::string &cell : cells) {
    if (number_of(cell)) {
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
    if (trimmed(line).empty() || line.starts_with("#")) {
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
      const auto value = number_of(cells[offset + i]);
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
