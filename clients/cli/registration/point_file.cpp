#include "clients/cli/registration/point_file.hpp"

#include <cmath>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>

#include <Eigen/Cholesky>

#include "base/text.hpp"
#include "casefile/markups.hpp"

namespace bregma::cli {

namespace {

using base::failure;
using base::Result;
using casefile::NamedPoint;

std::vector<std::string> cells_of(const std::string &line) {
  std::vector<std::string> out;
  for (std::string_view cell : base::cells(line, ',')) {
    const bool quoted = cell.size() > 1 && cell.front() == '"' && cell.back() == '"';
    out.emplace_back(quoted ? base::trimmed(cell.substr(1, cell.size() - 2)) : cell);
  }
  return out;
}

// A header row contains no numbers.
bool is_header(const std::vector<std::string> &cells) {
  for (const std::string &cell : cells) {
    if (base::parsed_number<double>(cell)) {
      return false;
    }
  }
  return true;
}

constexpr const char *kColumns = "must be \"x,y,z\" or \"name,x,y,z\", and may go on with \"sx,sy,sz\" or "
                                 "\"cxx,cxy,cxz,cyy,cyz,czz\"";

// Layout of a row: whether the first cell is a name (0 or 1), then three, six or nine numbers.
struct Row {
  std::size_t name = 0;
  std::size_t numbers = 0;
};

std::optional<Row> row_of(std::size_t cells) {
  for (const std::size_t numbers : {3U, 6U, 9U}) {
    if (cells == numbers || cells == numbers + 1) {
      return Row{cells - numbers, numbers};
    }
  }
  return std::nullopt;
}

std::string column_name(const Row &row, std::size_t index) {
  static constexpr const char *kSigmas[] = {"x", "y", "z", "sx", "sy", "sz"};
  static constexpr const char *kCovariance[] = {"x", "y", "z", "cxx", "cxy", "cxz", "cyy", "cyz", "czz"};
  return row.numbers == 9 ? kCovariance[index] : kSigmas[index];
}

// Covariance from the numbers after the position. Empty where they are not positive definite.
std::optional<Eigen::Matrix3d> covariance_of(const std::vector<double> &numbers) {
  if (numbers.size() == 6) {
    const Eigen::Vector3d sigma(numbers.data() + 3);
    return sigma.minCoeff() > 0.0 ? std::optional<Eigen::Matrix3d>(sigma.cwiseAbs2().asDiagonal()) : std::nullopt;
  }
  Eigen::Matrix3d out;
  out << numbers[3], numbers[4], numbers[5], numbers[4], numbers[6], numbers[7], numbers[5], numbers[7], numbers[8];
  return out.llt().info() == Eigen::Success ? std::optional(out) : std::nullopt;
}

Result<PointFile> read_csv(const std::filesystem::path &file) {
  std::error_code error;
  std::ifstream in(file);
  if (!in || std::filesystem::is_directory(file, error)) {
    return failure(file.string() + ": no such file, or it cannot be read");
  }
  PointFile out;
  std::size_t width = 0; // number of cells of the rows read so far
  bool header_allowed = true;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::string place = file.string() + ":" + std::to_string(number) + ": ";
    const std::vector<std::string> cells = cells_of(line);
    if (base::trimmed(line).empty() || line.starts_with("#")) {
      continue;
    }
    if (std::exchange(header_allowed, false) && is_header(cells)) {
      continue;
    }
    const auto row = row_of(cells.size());
    if (!row) {
      return failure(place + kColumns + "; this line has " + std::to_string(cells.size()) + " cells");
    }
    if (width != 0 && width != cells.size()) {
      return failure(place + "has " + std::to_string(cells.size()) + " cells, the lines before have " +
                     std::to_string(width));
    }
    width = cells.size();
    NamedPoint point;
    point.name = row->name == 1 ? cells[0] : std::to_string(out.points.size() + 1);
    std::vector<double> numbers;
    for (std::size_t i = 0; i < row->numbers; ++i) {
      const auto value = base::parsed_number<double>(cells[row->name + i]);
      if (!value || !std::isfinite(*value)) {
        return failure(place + "point " + point.name + ": " + column_name(*row, i) + " = \"" + cells[row->name + i] +
                       "\": must be a finite number");
      }
      numbers.push_back(*value);
    }
    point.position_mm = Eigen::Vector3d(numbers.data());
    if (row->numbers > 3) {
      const auto covariance = covariance_of(numbers);
      if (!covariance) {
        return failure(place + "point " + point.name + ": its error must be positive in every direction");
      }
      out.covariances.push_back(*covariance);
    }
    out.points.push_back(std::move(point));
  }
  return out;
}

Result<PointFile> read_any(const std::filesystem::path &file, const PointFileOptions &options) {
  const std::string name = file.filename().string();
  if (name.ends_with(".csv")) {
    auto out = read_csv(file);
    if (out && options.space == casefile::Space::kLps) {
      const Eigen::DiagonalMatrix<double, 3> flip(-1.0, -1.0, 1.0);
      for (NamedPoint &point : out->points) {
        point.position_mm = casefile::flipped(point.position_mm);
      }
      for (Eigen::Matrix3d &covariance : out->covariances) {
        covariance = flip * covariance * flip;
      }
    }
    return out;
  }
  if (name.ends_with(".json") || name.ends_with(".fcsv")) {
    auto points = casefile::read_points(file);
    return points ? Result<PointFile>(PointFile{std::move(*points), {}}) : tl::unexpected(points.error());
  }
  return failure(file.string() + ": is neither .csv nor .mrk.json nor .fcsv");
}

} // namespace

Result<PointFile> read_point_file(const std::filesystem::path &file, const PointFileOptions &options) {
  auto out = read_any(file, options);
  if (!out) {
    return out;
  }
  const double scale = casefile::mm_per(options.unit);
  std::vector<Eigen::Vector3d> positions;
  for (NamedPoint &point : out->points) {
    point.position_mm *= scale;
    positions.push_back(point.position_mm);
  }
  for (Eigen::Matrix3d &covariance : out->covariances) {
    covariance *= scale * scale;
  }
  if (positions.size() > 1) {
    const auto problem =
        casefile::size_problem(positions, options.size, options.unit, "the set of points", options.unit_option);
    if (!problem.empty()) {
      return failure(file.string() + ": " + problem);
    }
  }
  return out;
}

} // namespace bregma::cli
