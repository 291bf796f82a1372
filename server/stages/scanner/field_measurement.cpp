#include "server/stages/scanner/field_measurement.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <vector>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/mri/distortion_field.hpp"
#include "algorithms/mri/grid/grid_points.hpp"
#include "algorithms/mri/point_matching.hpp"
#include "algorithms/registration/points/paired_points.hpp"
#include "casefile/volumes/displacement_file.hpp"
#include "server/session/session_text.hpp"

namespace bregma::server {

namespace {

using geometry::Points3;

constexpr double kGrid_mm = 4.0;
constexpr double kMargin_mm = 24.0;
constexpr double kDetection_mm = 0.2; // 1 sigma of a coordinate of a control point
constexpr Eigen::Index kMinPairs = 20;
constexpr std::size_t kMovedPairs = 60; // of both scans of the phantom, spread over it
constexpr std::int64_t kDay_ns = 24LL * 3600 * 1'000'000'000;

std::string date_of(std::int64_t utc_ns) {
  const auto at = static_cast<std::time_t>(utc_ns / 1'000'000'000);
  std::tm utc{};
  gmtime_r(&at, &utc);
  char out[16];
  return {out, std::strftime(out, sizeof out, "%Y-%m-%d", &utc)};
}

// The beginning of a day; 0 for another text.
std::int64_t ns_of_date(const std::string &date) {
  int year = 0;
  unsigned month = 0, day = 0;
  if (std::sscanf(date.c_str(), "%d-%u-%u", &year, &month, &day) != 3) {
    return 0;
  }
  const std::chrono::year_month_day ymd{std::chrono::year(year), std::chrono::month(month), std::chrono::day(day)};
  return ymd.ok() ? std::chrono::sys_days(ymd).time_since_epoch().count() * kDay_ns : 0;
}

base::Result<Points3> control_points(image::Image<float, 3> phantom, const FieldMeasurement &input) {
  const auto T_image_device = mri::T_image_patient() * mri::T_device_patient(input.position).inverse();
  phantom.T_image_index = T_image_device.matrix() * phantom.T_image_index;
  mri::GridOptions options;
  options.cell_mm = input.cell_mm;
  options.bar_mm = input.bar_mm;
  auto found = mri::find_grid_points(phantom, options);
  if (!found) {
    return base::failure("the phantom: " + found.error());
  }
  return std::move(found->points_mm);
}

// Mean displacement of the control points between two scans, by the rigid motion that fits them best. NaN for fewer
// common points than determine it.
double moved_mm(const Points3 &first, const Points3 &second, double cell_mm) {
  std::vector<registration::PointPair> pairs;
  for (Eigen::Index i = 0; i < second.cols(); ++i) {
    Eigen::Index nearest = 0;
    const double d = (first.colwise() - second.col(i)).colwise().norm().minCoeff(&nearest);
    if (d < 0.4 * cell_mm) {
      pairs.push_back({first.col(nearest), second.col(i), kDetection_mm * kDetection_mm * Eigen::Matrix3d::Identity(),
                       kDetection_mm * kDetection_mm * Eigen::Matrix3d::Identity()});
    }
  }
  if (static_cast<Eigen::Index>(pairs.size()) < kMinPairs) {
    return geometry::kUnknown;
  }
  const std::size_t every = (pairs.size() + kMovedPairs - 1) / kMovedPairs;
  std::vector<registration::PointPair> spread;
  for (std::size_t i = 0; i < pairs.size(); i += every) {
    spread.push_back(pairs[i]);
  }
  const registration::PairedFit fit = registration::fit_paired(spread);
  if (!fit.converged) {
    return geometry::kUnknown;
  }
  double sum = 0.0;
  for (const registration::PointPair &pair : pairs) {
    sum += (fit.T_target_source * pair.source_mm - pair.source_mm).norm();
  }
  return sum / static_cast<double>(pairs.size());
}

base::Result<void> save(const FieldMeasurement &input, const ScannerField &field) {
  casefile::DisplacementField file;
  file.displacement_mm = field.table->displacements();
  file.signed_error_95_mm = field.table->signed_errors();
  file.max_error_95_mm = field.table->max_error_95_mm();
  file.scanner = input.scanner;
  file.protocol = input.protocol;
  file.patient_position = mri::name(input.position);
  file.made = date_of(input.utc_ns);
  file.expires = input.days > 0 ? date_of(input.utc_ns + input.days * kDay_ns) : "";
  return casefile::write_displacement_field(input.file, file);
}

} // namespace

base::Result<ScannerField> measure_field(const FieldMeasurement &input) {
  const auto points = control_points(input.phantom, input);
  if (!points) {
    return tl::unexpected(points.error());
  }
  ScannerField out;
  out.moved_mm = geometry::kUnknown;
  if (input.again) {
    const auto second = control_points(*input.again, input);
    if (!second) {
      return base::failure("its second scan: " + second.error().message);
    }
    out.moved_mm = moved_mm(*points, *second, input.cell_mm);
    if (!(out.moved_mm <= input.max_moved_mm)) {
      return base::failure(std::isnan(out.moved_mm)
                               ? std::string("the phantom moved during its scans: its control points do not agree")
                               : "the phantom moved by " + mm(out.moved_mm) + " during its scans (limit " +
                                     mm(input.max_moved_mm) + "): fix it and scan it again");
    }
  }
  const mri::MatchResult match = mri::match_points(input.reference_mm, *points);
  if (match.outcome != mri::MatchOutcome::kMatched) {
    return base::failure(std::string("the phantom's control points in CT and MR: ") + mri::name(match.outcome) + ", " +
                         std::to_string(match.pairs.size()) + " pairs");
  }
  const Points3 truth = match.reference_points(input.reference_mm), imaged = match.imaged_points(*points);
  const auto field = mri::DistortionField::fit(truth, imaged);
  const auto residual = mri::hold_out(truth, imaged);
  if (!field || !residual) {
    return base::failure("the distortion field: " + (!field ? field.error() : residual.error()));
  }
  out.table = std::make_shared<const mri::FieldTable>(*field, kGrid_mm, kMargin_mm);
  out.position = input.position;
  out.scanner = input.scanner;
  out.identity = input.scanner + " " + date_of(input.utc_ns);
  out.made_ns = input.utc_ns;
  out.expires_ns = input.days > 0 ? input.utc_ns + input.days * kDay_ns : 0;
  out.points = static_cast<std::uint32_t>(match.pairs.size());
  out.initial_mm = mri::summarise(imaged - truth).overall.mean_mm;
  out.residual_mm = residual->overall.mean_mm;
  out.residual_max_mm = residual->overall.max_mm;
  if (!input.file.empty()) {
    if (auto saved = save(input, out); !saved) {
      return tl::unexpected(saved.error());
    }
  }
  return out;
}

base::Result<ScannerField> load_field(const std::filesystem::path &file) {
  const auto read = casefile::read_displacement_field(file);
  if (!read) {
    return tl::unexpected(read.error());
  }
  const auto position = mri::parse_patient_position(read->patient_position);
  if (!position) {
    return base::failure(file.string() + ": " + position.error());
  }
  ScannerField out;
  out.table =
      std::make_shared<const mri::FieldTable>(read->displacement_mm, read->signed_error_95_mm, read->max_error_95_mm);
  out.position = *position;
  out.scanner = read->scanner;
  out.identity = read->scanner + (read->scanner.empty() ? "" : " ") + read->made;
  out.made_ns = ns_of_date(read->made);
  out.expires_ns = read->expires.empty() ? 0 : ns_of_date(read->expires) + kDay_ns; // the last day counts
  out.initial_mm = out.residual_mm = out.residual_max_mm = out.moved_mm = geometry::kUnknown;
  return out;
}

} // namespace bregma::server
