#include "casefile/robot_tools.hpp"

#include <algorithm>
#include <utility>

#include "algorithms/geometry/angles.hpp"
#include "base/table_reader.hpp"

namespace bregma::casefile {

namespace {

constexpr std::size_t kMaxName = 31; // bytes, as on the wire
constexpr double kMinAxisLength = 1e-6;

} // namespace

base::Result<std::vector<RobotToolModel>> read_robot_tools(const std::filesystem::path &file) {
  const auto document = base::TomlDocument::read(file);
  if (!document) {
    return tl::unexpected(document.error());
  }
  base::TableReader root = document->root();
  std::vector<RobotToolModel> out;
  for (base::TableReader &table : root.tables("tools")) {
    RobotToolModel tool;
    tool.name = table.require_string("name");
    tool.tip_mm = table.require_vector3("tip_mm");
    tool.axis = table.vector3("axis", tool.axis);
    tool.sigma_mm = table.require_number("sigma_mm", "mm", 0.001, 10.0);
    tool.sigma_rad = table.number("sigma_deg", 0.0, "deg", 0.0, 10.0) * geometry::kRadiansPerDegree;
    if (tool.name.empty() || tool.name.size() > kMaxName) {
      table.refuse("name", "must have 1 to 31 bytes");
    }
    if (std::any_of(out.begin(), out.end(), [&](const RobotToolModel &other) { return other.name == tool.name; })) {
      table.refuse("name", "appears twice");
    }
    if (tool.axis.norm() < kMinAxisLength) {
      table.refuse("axis", "has no length");
    }
    tool.axis.normalize();
    if (auto ok = table.finish(); !ok) {
      return tl::unexpected(ok.error());
    }
    out.push_back(std::move(tool));
  }
  if (out.empty()) {
    root.refuse("tools", "at least one is needed");
  }
  if (auto ok = root.finish(); !ok) {
    return tl::unexpected(ok.error());
  }
  return out;
}

} // namespace bregma::casefile
