#include "casefile/dh_arm.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include "algorithms/geometry/angles.hpp"
#include "base/table_reader.hpp"

namespace bregma::casefile {

using geometry::kRadiansPerDegree;

base::Result<robot::ArmModel> parse_dh_arm(std::string_view text, const std::string &name) {
  const auto document = base::TomlDocument::parse(text, name);
  if (!document) {
    return tl::unexpected(document.error());
  }
  base::TableReader root = document->root();
  const std::string arm = root.require_string("name");
  std::vector<base::TableReader> tables = root.tables("joints");
  if (tables.size() != robot::kJoints) {
    root.refuse("joints", "an arm of six joints is needed, these are " + std::to_string(tables.size()));
  }
  std::array<robot::DhRow, robot::kJoints> rows;
  std::array<robot::JointLimits, robot::kJoints> limits;
  for (std::size_t i = 0; i < std::min(tables.size(), robot::kJoints); ++i) {
    base::TableReader &table = tables[i];
    rows[i].d_mm = table.require_number("d_mm", "mm", -5000.0, 5000.0);
    rows[i].alpha_rad = kRadiansPerDegree * table.require_number("alpha_deg", "deg", -360.0, 360.0);
    rows[i].a_mm = table.require_number("a_mm", "mm", -5000.0, 5000.0);
    rows[i].offset_rad = kRadiansPerDegree * table.number("offset_deg", 0.0, "deg", -360.0, 360.0);
    const double lower = table.require_number("min_deg", "deg", -3600.0, 3600.0);
    const double upper = table.require_number("max_deg", "deg", -3600.0, 3600.0);
    limits[i] = {kRadiansPerDegree * lower, kRadiansPerDegree * upper};
    if (!(lower < upper)) {
      table.refuse("max_deg", "must be above min_deg");
    }
    if (auto ok = table.finish(); !ok) {
      return tl::unexpected(ok.error());
    }
  }
  if (auto ok = root.finish(); !ok) {
    return tl::unexpected(ok.error());
  }
  return robot::ArmModel::from_dh(arm, rows, limits);
}

} // namespace bregma::casefile
