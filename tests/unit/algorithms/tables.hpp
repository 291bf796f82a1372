// Numbers from the CSV files of the shared data.
#pragma once

#include <charconv>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "algorithms/geometry/points.hpp"

namespace bregma::test {

// All rows of a table; cells without a number are NaN. skip: number of heading rows.
inline std::vector<std::vector<double>> read_table(const std::filesystem::path &file, int skip = 0) {
  std::vector<std::vector<double>> rows;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (skip-- > 0 || line.empty()) {
      continue;
    }
    std::vector<double> row;
    for (std::size_t begin = 0; begin <= line.size();) {
      const std::size_t end = std::min(line.find(',', begin), line.size());
      double value = std::numeric_limits<double>::quiet_NaN();
      std::from_chars(line.data() + begin, line.data() + end, value);
      row.push_back(value);
      begin = end + 1;
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

template <int D>
geometry::Points<D> read_points(const std::filesystem::path &file, int skip = 0, std::size_t column = 0) {
  const auto rows = read_table(file, skip);
  geometry::Points<D> out(D, static_cast<Eigen::Index>(rows.size()));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t d = 0; d < static_cast<std::size_t>(D); ++d) {
      out(static_cast<Eigen::Index>(d), static_cast<Eigen::Index>(i)) = rows[i].at(column + d);
    }
  }
  return out;
}

} // namespace bregma::test
