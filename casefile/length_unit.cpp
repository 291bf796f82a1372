#include "casefile/length_unit.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>

#include <Eigen/Geometry>

namespace bregma::casefile {

namespace {

struct NamedUnit {
  LengthUnit unit;
  std::string_view name;
  std::string_view in_words;
  double mm;
};

constexpr std::array<NamedUnit, 4> kUnits{{{LengthUnit::kMillimetre, "mm", "millimetres", 1.0},
                                           {LengthUnit::kCentimetre, "cm", "centimetres", 10.0},
                                           {LengthUnit::kMetre, "m", "metres", 1000.0},
                                           {LengthUnit::kMicrometre, "um", "micrometres", 0.001}}};

// Range of head widths, used to find the unit that explains a width.
constexpr double kHeadFrom_mm = 80.0;
constexpr double kHeadTo_mm = 450.0;

std::string shown_width(double mm) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.3g", mm);
  // Avoids exponents such as 2e+04.
  if (mm >= 1000.0) {
    std::snprintf(buffer, sizeof buffer, "%.0f", mm);
  }
  return buffer;
}

const NamedUnit &entry_of(LengthUnit unit) { return kUnits[static_cast<std::size_t>(unit)]; }

} // namespace

double mm_per(LengthUnit unit) { return entry_of(unit).mm; }

std::string_view name_of(LengthUnit unit) { return entry_of(unit).name; }

std::optional<LengthUnit> unit_named(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, LengthUnit>, 19> kWords{{{"millimeter", LengthUnit::kMillimetre},
                                                                            {"millimetre", LengthUnit::kMillimetre},
                                                                            {"millimeters", LengthUnit::kMillimetre},
                                                                            {"millimetres", LengthUnit::kMillimetre},
                                                                            {"centimeter", LengthUnit::kCentimetre},
                                                                            {"centimetre", LengthUnit::kCentimetre},
                                                                            {"centimeters", LengthUnit::kCentimetre},
                                                                            {"centimetres", LengthUnit::kCentimetre},
                                                                            {"meter", LengthUnit::kMetre},
                                                                            {"metre", LengthUnit::kMetre},
                                                                            {"meters", LengthUnit::kMetre},
                                                                            {"metres", LengthUnit::kMetre},
                                                                            {"micrometer", LengthUnit::kMicrometre},
                                                                            {"micrometre", LengthUnit::kMicrometre},
                                                                            {"micrometers", LengthUnit::kMicrometre},
                                                                            {"micrometres", LengthUnit::kMicrometre},
                                                                            {"micron", LengthUnit::kMicrometre},
                                                                            {"microns", LengthUnit::kMicrometre},
                                                                            {"\u00b5m", LengthUnit::kMicrometre}}};
  for (const NamedUnit &known : kUnits) {
    if (known.name == name) {
      return known.unit;
    }
  }
  const auto word =
      std::find_if(kWords.begin(), kWords.end(), [name](const auto &known) { return known.first == name; });
  return word != kWords.end() ? std::optional(word->second) : std::nullopt;
}

double width_mm(std::span<const Eigen::Vector3d> points_mm) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d &p : points_mm) {
    box.extend(p);
  }
  return box.isEmpty() ? 0.0 : box.sizes().maxCoeff();
}

std::string size_problem(std::span<const Eigen::Vector3d> points_mm, const SizeLimits &limits, LengthUnit read_in,
                         std::string_view what, std::string_view option) {
  const double width = width_mm(points_mm);
  if (width >= limits.smallest_mm && width <= limits.largest_mm) {
    return {};
  }
  const bool small = width < limits.smallest_mm;
  std::string out = std::string(what) + " is " + shown_width(width) + " mm wide, " +
                    (small ? "at least " : "at most ") + shown_width(small ? limits.smallest_mm : limits.largest_mm) +
                    " mm is taken";
  constexpr double kInch_mm = 25.4;
  const double as_inches_mm = width / mm_per(read_in) * kInch_mm;
  const std::string inches =
      small && as_inches_mm >= kHeadFrom_mm && as_inches_mm <= kHeadTo_mm ? "; inches are not read, convert them" : "";
  for (const NamedUnit &other : kUnits) {
    const double as_other_mm = width / mm_per(read_in) * other.mm;
    if (other.unit != read_in && as_other_mm >= kHeadFrom_mm && as_other_mm <= kHeadTo_mm) {
      return (option.empty() ? out + ": is the file in " + std::string(other.in_words) + "?"
                             : out + ": if the file is in " + std::string(other.in_words) + ", say " +
                                   std::string(option) + " " + std::string(other.name)) +
             inches;
    }
  }
  return out + inches;
}

} // namespace bregma::casefile
