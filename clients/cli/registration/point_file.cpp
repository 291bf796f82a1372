#include "clients/cli/registration/point_file.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "base/text.hpp"
#include "casefile/markups.hpp"
#include "casefile/point_table.hpp"

namespace bregma::cli {

namespace {

using base::failure;
using base::Result;

Result<PointFile> read_table(const std::filesystem::path &file, const PointFileOptions &options) {
  auto table = casefile::read_point_table(file, {.space = options.space, .unit = options.unit});
  if (!table) {
    return tl::unexpected(table.error());
  }
  PointFile out;
  out.named = table->named;
  out.notes = std::move(table->notes);
  for (const casefile::TablePoint &point : table->points) {
    out.points.push_back({point.name, point.position_mm});
    if (point.covariance_mm2) {
      out.covariances.push_back(*point.covariance_mm2);
    }
  }
  return out;
}

Result<PointFile> read_slicer(const std::filesystem::path &file, const PointFileOptions &options) {
  PointFile out;
  casefile::MarkupDefaults defaults;
  defaults.space = options.space;
  if (options.unit != casefile::LengthUnit::kMillimetre) {
    defaults.unit = options.unit;
  }
  auto points = casefile::read_points(file, &out.notes, defaults);
  if (!points) {
    return tl::unexpected(points.error());
  }
  out.points = std::move(*points);
  const auto elsewhere = std::find_if(out.points.begin(), out.points.end(), [&out](const casefile::NamedPoint &point) {
    return point.placed_in != out.points.front().placed_in;
  });
  if (elsewhere != out.points.end()) {
    const auto place = [](const casefile::NamedPoint &point) {
      return "\"" + point.name + "\" in " +
             (point.placed_in.empty() ? "no named image" : "the image " + point.placed_in);
    };
    return failure(file.string() + ": its points were placed in different images: " + place(out.points.front()) + ", " +
                   place(*elsewhere) + "; register the points of one image");
  }
  for (const casefile::NamedPoint &point : out.points) {
    if (!point.placed_in.empty()) {
      out.notes.push_back(file.string() + ": " + point.name + " was placed in the image " + point.placed_in +
                          ", and is in its coordinates");
    }
  }
  const auto has_name = [](const casefile::NamedPoint &point) { return !base::trimmed(point.name).empty(); };
  out.named = std::all_of(out.points.begin(), out.points.end(), has_name);
  if (options.unit != casefile::LengthUnit::kMillimetre || options.space) {
    out.notes.push_back(file.string() + ": a space or a unit that it states has priority over options");
  }
  return out;
}

Result<PointFile> read_any(const std::filesystem::path &file, const PointFileOptions &options) {
  const std::string extension = base::lower(file.extension().string());
  if (casefile::is_point_table(file)) {
    return read_table(file, options);
  }
  if (extension == ".json" || extension == ".fcsv") {
    return read_slicer(file, options);
  }
  return failure(file.string() + ": is neither a table (.csv, .tsv, .txt) nor .mrk.json nor .fcsv");
}

} // namespace

Result<PointFile> read_point_file(const std::filesystem::path &file, const PointFileOptions &options) {
  auto out = read_any(file, options);
  if (!out) {
    return out;
  }
  std::vector<Eigen::Vector3d> positions;
  for (const casefile::NamedPoint &point : out->points) {
    positions.push_back(point.position_mm);
  }
  if (positions.size() > 1) {
    const auto unit = casefile::is_point_table(file) ? options.unit : casefile::LengthUnit::kMillimetre;
    const auto problem =
        casefile::size_problem(positions, options.size, unit, "the set of points", options.unit_option);
    if (!problem.empty()) {
      return failure(file.string() + ": " + problem);
    }
  }
  return out;
}

} // namespace bregma::cli
