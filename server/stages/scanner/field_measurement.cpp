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
#include "algorithms/mri/lattice.hpp"
#include "algorithms/mri/point_matching.hpp"
#include "algorithms/mri/separation.hpp"
#include "algorithms/registration/points/paired_points.hpp"
#include "casefile/volumes/scan_fields_file.hpp"
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

auto T_image_device_of(mri::PatientPosition position) {
  return mri::T_image_patient() * mri::T_device_patient(position).inverse();
}

base::Result<Points3> control_points(image::Image<float, 3> phantom, const FieldMeasurement &input) {
  const auto T_image_device = T_image_device_of(input.position);
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
  casefile::FieldHeader header;
  header.scanner = input.scanner;
  header.protocol = input.protocol;
  header.patient_position = mri::name(input.position);
  header.made = date_of(input.utc_ns);
  header.expires = input.days > 0 ? date_of(input.utc_ns + input.days * kDay_ns) : "";
  return casefile::write_scan_fields(input.file, *field.scans, header);
}

// Fields, and how far they are from points that were held out.
struct MeasuredFields {
  std::shared_ptr<const mri::ScanFields> scans;
  Eigen::Index points = 0;
  mri::ErrorSummary initial, residual;
};

base::Result<mri::MatchResult> matched(const FieldMeasurement &input, const Points3 &points) {
  mri::MatchResult out = mri::match_points(input.reference_mm, points);
  if (out.outcome != mri::MatchOutcome::kMatched) {
    return base::failure(std::string("the phantom's control points in CT and MR: ") + mri::name(out.outcome) + ", " +
                         std::to_string(out.pairs.size()) + " pairs");
  }
  return out;
}

base::Result<MeasuredFields> fields_of_one_read_out(const FieldMeasurement &input, const Points3 &points,
                                                    const Eigen::Vector3d &mm_per_Hz) {
  const auto match = matched(input, points);
  if (!match) {
    return tl::unexpected(match.error());
  }
  const Points3 truth = match->reference_points(input.reference_mm), imaged = match->imaged_points(points);
  const auto field = mri::DistortionField::fit(truth, imaged);
  const auto residual = mri::hold_out(truth, imaged);
  if (!field || !residual) {
    return base::failure("the distortion field: " + (!field ? field.error() : residual.error()));
  }
  return MeasuredFields{std::make_shared<const mri::ScanFields>(
                            std::make_shared<const mri::FieldTable>(*field, kGrid_mm, kMargin_mm), mm_per_Hz),
                        truth.cols(), mri::summarise(imaged - truth), *residual};
}

base::Result<MeasuredFields> fields_of_both_read_outs(const FieldMeasurement &input, const Points3 &forward,
                                                      const Points3 &reversed, const Eigen::Vector3d &mm_per_Hz) {
  const auto one = matched(input, forward), other = matched(input, reversed);
  if (!one || !other) {
    return one ? base::failure("with the read-out reversed: " + other.error().message)
               : base::failure(one.error().message);
  }
  const Eigen::Index count = input.reference_mm.cols();
  std::vector<mri::PhantomScan> scans{mri::phantom_scan(*one, count, forward, mm_per_Hz),
                                      mri::phantom_scan(*other, count, reversed, -mm_per_Hz)};
  const auto placed = mri::place_reference(input.reference_mm, scans);
  if (!placed) {
    return base::failure("the distortion field: no control point is shown by both read-outs");
  }
  std::vector<Eigen::Index> shown; // by both
  for (Eigen::Index i = 0; i < count; ++i) {
    if (scans[0].imaged_mm.col(i).allFinite() && scans[1].imaged_mm.col(i).allFinite()) {
      shown.push_back(i);
    }
  }
  const auto part = [&](const std::vector<Eigen::Index> &points, const Points3 &of) -> Points3 {
    return of(Eigen::all, shown)(Eigen::all, points);
  };
  const auto part_of_scans = [&](const std::vector<Eigen::Index> &points) {
    return std::vector<mri::PhantomScan>{{part(points, scans[0].imaged_mm), mm_per_Hz},
                                         {part(points, scans[1].imaged_mm), -mm_per_Hz}};
  };
  const auto [used, tested] = mri::every_other((*placed)(Eigen::all, shown));
  const auto field = mri::separate_fields(*placed, scans);
  const auto half = mri::separate_fields(part(used, *placed), part_of_scans(used));
  if (!field || !half) {
    return base::failure("the distortion field: " + (!field ? field.error() : half.error()));
  }
  const Points3 tested_real = part(tested, *placed);
  const mri::PhantomScan tested_scan = part_of_scans(tested).front();
  return MeasuredFields{std::make_shared<const mri::ScanFields>(*field, mm_per_Hz, kGrid_mm, kMargin_mm),
                        static_cast<Eigen::Index>(shown.size()),
                        mri::summarise(Points3(scans[0].imaged_mm(Eigen::all, shown) - (*placed)(Eigen::all, shown))),
                        mri::summarise(mri::residuals(*half, tested_real, tested_scan))};
}

} // namespace

Eigen::Vector3d in_field(const ScannerField &field, const Eigen::Vector3d &mm_per_Hz) {
  return T_image_device_of(field.position).rotation() * mm_per_Hz;
}

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
  const Eigen::Vector3d mm_per_Hz = T_image_device_of(input.position).rotation() * input.mm_per_Hz;
  base::Result<MeasuredFields> fields = base::failure("");
  if (input.reversed) {
    const auto reversed = control_points(*input.reversed, input);
    if (!reversed) {
      return base::failure("with the read-out reversed: " + reversed.error().message);
    }
    fields = fields_of_both_read_outs(input, *points, *reversed, mm_per_Hz);
  } else {
    fields = fields_of_one_read_out(input, *points, mm_per_Hz);
  }
  if (!fields) {
    return tl::unexpected(fields.error());
  }
  out.scans = fields->scans;
  out.position = input.position;
  out.scanner = input.scanner;
  out.identity = input.scanner + " " + date_of(input.utc_ns);
  out.made_ns = input.utc_ns;
  out.expires_ns = input.days > 0 ? input.utc_ns + input.days * kDay_ns : 0;
  out.points = static_cast<std::uint32_t>(fields->points);
  out.initial_mm = fields->initial.overall.mean_mm;
  out.residual_mm = fields->residual.overall.mean_mm;
  out.residual_max_mm = fields->residual.overall.max_mm;
  if (input.unwanted && input.unwanted->load()) {
    return base::failure("the measurement was reset");
  }
  if (!input.file.empty()) {
    if (auto saved = save(input, out); !saved) {
      return tl::unexpected(saved.error());
    }
  }
  return out;
}

base::Result<ScannerField> load_field(const std::filesystem::path &file) {
  auto read = casefile::read_scan_fields(file);
  if (!read) {
    return tl::unexpected(read.error());
  }
  const casefile::FieldHeader &header = read->header;
  const auto position = mri::parse_patient_position(header.patient_position);
  if (!position) {
    return base::failure(file.string() + ": " + position.error());
  }
  ScannerField out;
  out.scans = std::make_shared<const mri::ScanFields>(std::move(read->fields));
  out.position = *position;
  out.scanner = header.scanner;
  out.identity = header.scanner + (header.scanner.empty() ? "" : " ") + header.made;
  out.made_ns = ns_of_date(header.made);
  out.expires_ns = header.expires.empty() ? 0 : ns_of_date(header.expires) + kDay_ns; // the last day counts
  out.initial_mm = out.residual_mm = out.residual_max_mm = out.moved_mm = geometry::kUnknown;
  return out;
}

} // namespace bregma::server
