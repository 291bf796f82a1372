#include "algorithms/mri/frames.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <vector>

#include "algorithms/geometry/angles.hpp"

namespace bregma::mri {

namespace {

using Eigen::Index;
using geometry::Matrix3d;

constexpr double kDirectionTolerance = 1e-3;

struct NamedPosition {
  PatientPosition position;
  const char *name;
  // Device's axis (0 x, 1 y, 2 z) and sign of Patient's left and posterior; superior follows from both.
  int left_axis, left_sign, posterior_axis, posterior_sign;
};

// Supine on the back, head first: the patient's left is at the viewer's right, the face is up, and the feet point to
// the viewer. The others are turns of this one.
constexpr std::array kPositions = {NamedPosition{PatientPosition::kHfs, "HFS", 0, 1, 1, -1},
                                   NamedPosition{PatientPosition::kHfp, "HFP", 0, -1, 1, 1},
                                   NamedPosition{PatientPosition::kHfdr, "HFDR", 1, 1, 0, 1},
                                   NamedPosition{PatientPosition::kHfdl, "HFDL", 1, -1, 0, -1},
                                   NamedPosition{PatientPosition::kFfs, "FFS", 0, -1, 1, -1},
                                   NamedPosition{PatientPosition::kFfp, "FFP", 0, 1, 1, 1},
                                   NamedPosition{PatientPosition::kFfdr, "FFDR", 1, 1, 0, -1},
                                   NamedPosition{PatientPosition::kFfdl, "FFDL", 1, -1, 0, 1}};

std::string shown(const Vector3d &v) {
  char text[96];
  std::snprintf(text, sizeof text, "%g, %g, %g", v.x(), v.y(), v.z());
  return text;
}

// Axes of Patient by their letters: sagittal planes have their normal along x, coronal along y, transverse along z.
constexpr std::array<std::string_view, 3> kPlaneNames = {"Sag", "Cor", "Tra"};

// The largest component first; its sign becomes positive.
struct SortedNormal {
  std::array<Index, 3> axis{};
  Vector3d component = Vector3d::Zero(); // in the order of axis
};
SortedNormal sorted(const Vector3d &normal) {
  SortedNormal out;
  out.axis = {2, 1, 0}; // the order of equal components
  std::stable_sort(out.axis.begin(), out.axis.end(),
                   [&](Index a, Index b) { return std::abs(normal[a]) > std::abs(normal[b]) + 1e-6; });
  const Vector3d unit = normal.normalized() * (normal[out.axis[0]] < 0.0 ? -1.0 : 1.0);
  out.component = {unit[out.axis[0]], unit[out.axis[1]], unit[out.axis[2]]};
  return out;
}

struct Tilts {
  std::array<Index, 3> axis{};
  std::array<double, 2> tenths{}; // of degrees, whole
};
Tilts tilts_of(const Vector3d &normal) {
  const SortedNormal n = sorted(normal);
  const auto tenths = [](double rad) { return std::round(10.0 * rad / geometry::kRadiansPerDegree); };
  return {
      n.axis,
      {tenths(std::atan2(n.component[1], n.component[0])), tenths(std::asin(std::clamp(n.component[2], -1.0, 1.0)))}};
}

class OrientationParser {
public:
  explicit OrientationParser(std::string_view text) : text_(text), rest_(text) {}

  tl::expected<Vector3d, std::string> parse() {
    auto main = axis();
    if (!main) {
      return tl::unexpected(main.error());
    }
    Vector3d normal = Vector3d::Unit(*main);
    std::vector<Index> used{*main};
    while (skip_blanks(), !rest_.empty()) {
      if (rest_.front() != '>' || used.size() == 3) {
        return error("expected '>' and at most two tilts, found '" + std::string(rest_) + "'");
      }
      rest_.remove_prefix(1);
      const auto next = axis();
      if (!next) {
        return tl::unexpected(next.error());
      }
      if (std::find(used.begin(), used.end(), *next) != used.end()) {
        return error("an axis is repeated");
      }
      used.push_back(*next);
      const auto tilt = degrees();
      if (!tilt) {
        return tl::unexpected(tilt.error());
      }
      const double angle = *tilt * geometry::kRadiansPerDegree;
      normal = std::cos(angle) * normal + std::sin(angle) * Vector3d::Unit(*next);
    }
    return normal;
  }

private:
  [[nodiscard]] tl::unexpected<std::string> error(const std::string &what) const {
    return tl::unexpected("orientation '" + std::string(text_) + "': " + what);
  }
  void skip_blanks() {
    while (!rest_.empty() && rest_.front() == ' ') {
      rest_.remove_prefix(1);
    }
  }
  tl::expected<Index, std::string> axis() {
    skip_blanks();
    for (std::size_t i = 0; i < kPlaneNames.size(); ++i) {
      for (const std::string_view form : {kPlaneNames[i], kPlaneNames[i].substr(0, 1)}) {
        if (rest_.starts_with(form)) {
          rest_.remove_prefix(form.size());
          return static_cast<Index>(i);
        }
      }
    }
    return error("expected S, C or T, found '" + std::string(rest_) + "'");
  }
  tl::expected<double, std::string> degrees() {
    skip_blanks();
    if (rest_.starts_with('+')) {
      rest_.remove_prefix(1);
    }
    double value = 0.0;
    const auto [end, status] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), value);
    if (status != std::errc() || !(std::abs(value) <= 90.0)) {
      return error("expected an angle of at most 90 degrees, found '" + std::string(rest_) + "'");
    }
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    return value;
  }

  std::string_view text_, rest_;
};

} // namespace

const char *name(PatientPosition position) noexcept {
  for (const NamedPosition &p : kPositions) {
    if (p.position == position) {
      return p.name;
    }
  }
  return "?";
}

tl::expected<PatientPosition, std::string> parse_patient_position(std::string_view text) {
  while (text.ends_with(' ')) { // DICOM pads to an even length
    text.remove_suffix(1);
  }
  for (const NamedPosition &p : kPositions) {
    if (text == p.name) {
      return p.position;
    }
  }
  return tl::unexpected("patient position '" + std::string(text) +
                        "' is none of HFS, HFP, HFDR, HFDL, FFS, FFP, FFDR, FFDL");
}

Rigid3<frame::Device, frame::Patient> T_device_patient(PatientPosition position) {
  Matrix3d R = Matrix3d::Identity();
  for (const NamedPosition &p : kPositions) {
    if (p.position == position) {
      R.col(0) = p.left_sign * Vector3d::Unit(p.left_axis);
      R.col(1) = p.posterior_sign * Vector3d::Unit(p.posterior_axis);
      R.col(2) = R.col(0).cross(R.col(1));
    }
  }
  return {R, Vector3d::Zero()};
}

Rigid3<geometry::frame::Image, frame::Patient> T_image_patient() {
  return {Eigen::Quaterniond(0.0, 0.0, 0.0, 1.0), Vector3d::Zero()};
}

Vector3d direction_in_slice(EncodingDirection direction) noexcept {
  switch (direction) {
  case EncodingDirection::kRowPositive:
    return Vector3d::UnitX();
  case EncodingDirection::kRowNegative:
    return -Vector3d::UnitX();
  case EncodingDirection::kColumnPositive:
    return Vector3d::UnitY();
  case EncodingDirection::kColumnNegative:
    return -Vector3d::UnitY();
  case EncodingDirection::kUnknown:
    break;
  }
  return Vector3d::Zero();
}

tl::expected<SlicePlane, std::string> SlicePlane::from(const SliceHeader &header) {
  if (!header.position_mm.allFinite()) {
    return tl::unexpected("ImagePositionPatient (" + shown(header.position_mm) + ") is not finite");
  }
  for (const auto &[direction, label] :
       {std::pair(&header.along_row, "row"), std::pair(&header.along_column, "column")}) {
    if (!(std::abs(direction->norm() - 1.0) < kDirectionTolerance)) {
      return tl::unexpected("ImageOrientationPatient: the direction of a " + std::string(label) + " (" +
                            shown(*direction) + ") is not of unit length");
    }
  }
  if (const double cosine = header.along_row.dot(header.along_column); !(std::abs(cosine) < kDirectionTolerance)) {
    return tl::unexpected("ImageOrientationPatient: row (" + shown(header.along_row) + ") and column (" +
                          shown(header.along_column) + ") are not perpendicular");
  }
  for (const auto &[value, label] :
       {std::pair(header.row_spacing_mm, "first"), std::pair(header.column_spacing_mm, "second")}) {
    if (!(value > 0.0) || !std::isfinite(value)) {
      return tl::unexpected("PixelSpacing: the " + std::string(label) + " value " + std::to_string(value) +
                            " is not positive");
    }
  }
  if (header.rows < 1 || header.columns < 1) {
    return tl::unexpected("Rows " + std::to_string(header.rows) + " or Columns " + std::to_string(header.columns) +
                          " is not positive");
  }
  if (!(header.thickness_mm >= 0.0) || !std::isfinite(header.thickness_mm)) {
    return tl::unexpected("SliceThickness " + std::to_string(header.thickness_mm) + " is negative or not finite");
  }

  SlicePlane out;
  out.header_ = header;
  const Vector3d x = header.along_row.normalized();
  const Vector3d y = (header.along_column - header.along_column.dot(x) * x).normalized();
  out.header_.along_row = x;
  out.header_.along_column = y;
  if (out.header_.read_out == EncodingDirection::kUnknown) {
    out.header_.read_out = EncodingDirection::kRowPositive;
  }

  Matrix3d R_patient_slice;
  R_patient_slice << x, y, x.cross(y);
  const Vector3d read = direction_in_slice(out.header_.read_out);
  Matrix3d R_slice_gradient;
  R_slice_gradient << read, Vector3d::UnitZ().cross(read), Vector3d::UnitZ();
  const Vector3d centre = out.pixel_mm(0.5 * (header.columns - 1), 0.5 * (header.rows - 1));
  const Rigid3<frame::Slice, frame::Gradient> T_slice_gradient(R_slice_gradient, centre);
  const Rigid3<frame::Patient, frame::Slice> T_patient_slice(R_patient_slice, header.position_mm);
  out.T_gradient_slice_ = T_slice_gradient.inverse();
  out.T_patient_gradient_ = T_patient_slice * T_slice_gradient;
  return out;
}

const char *name(Orientation orientation) noexcept {
  switch (orientation) {
  case Orientation::kSagittal:
    return "sagittal";
  case Orientation::kCoronal:
    return "coronal";
  case Orientation::kTransverse:
    return "transverse";
  case Orientation::kOblique:
    return "oblique";
  case Orientation::kDoubleOblique:
    return "double oblique";
  }
  return "?";
}

tl::expected<Vector3d, std::string> parse_orientation(std::string_view text) { return OrientationParser(text).parse(); }

std::string print_orientation(const Vector3d &normal_patient) {
  const Tilts tilts = tilts_of(normal_patient);
  std::string out(1, kPlaneNames[static_cast<std::size_t>(tilts.axis[0])].front());
  for (std::size_t i = 0; i < 2; ++i) {
    if (tilts.tenths[i] != 0.0) {
      char angle[16];
      std::snprintf(angle, sizeof angle, "%.1f", 0.1 * tilts.tenths[i]);
      out += '>';
      out += kPlaneNames[static_cast<std::size_t>(tilts.axis[i + 1])].front();
      out += angle;
    }
  }
  return out;
}

Orientation orientation_of(const Vector3d &normal_patient) {
  const Tilts tilts = tilts_of(normal_patient);
  const auto tilted = std::count_if(tilts.tenths.begin(), tilts.tenths.end(), [](double t) { return t != 0.0; });
  if (tilted > 0) {
    return tilted == 1 ? Orientation::kOblique : Orientation::kDoubleOblique;
  }
  constexpr std::array kMain = {Orientation::kSagittal, Orientation::kCoronal, Orientation::kTransverse};
  return kMain[static_cast<std::size_t>(tilts.axis[0])];
}

PlaneDirections plane_directions(const Vector3d &normal_patient) {
  const SortedNormal sorted_normal = sorted(normal_patient);
  Vector3d n;
  for (std::size_t i = 0; i < 3; ++i) {
    n[sorted_normal.axis[i]] = sorted_normal.component[static_cast<Index>(i)];
  }
  switch (sorted_normal.axis[0]) {
  case 2: {
    const Vector3d along_column = Vector3d(0.0, n.z(), -n.y()).normalized();
    return {along_column.cross(n), along_column};
  }
  case 1: {
    const Vector3d along_row = Vector3d(n.y(), -n.x(), 0.0).normalized();
    return {along_row, n.cross(along_row)};
  }
  default: {
    // Sagittal images show the face at the left: their normal points to the right.
    const Vector3d along_row = Vector3d(-n.y(), n.x(), 0.0).normalized();
    return {along_row, along_row.cross(n)};
  }
  }
}

} // namespace bregma::mri
