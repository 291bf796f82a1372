#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/text.hpp"
#include "casefile/arm_files/arm_file.hpp"
#include "casefile/surface_files/xml_document.hpp"

namespace bregma::casefile {

namespace {

using detail::XmlElement;
using Fixed = geometry::Rigid3<geometry::frame::Target, geometry::frame::Source>;

constexpr double kMillimetresPerMetre = 1000.0;

struct UrdfJoint {
  std::string name, parent, child;
  bool moves = false;
  Fixed T_parent_joint;
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX(); // URDF's default
  robot::JointLimits limits;
};

// Three numbers between blanks; the fallback for an absent attribute.
std::optional<Eigen::Vector3d> three(std::string_view text, const Eigen::Vector3d &fallback) {
  if (base::trimmed(text).empty()) {
    return fallback;
  }
  Eigen::Vector3d out;
  int count = 0;
  for (const std::string_view cell : base::cells(text, ' ')) {
    if (cell.empty()) {
      continue;
    }
    const auto value = base::parsed_number<double>(cell);
    if (!value || !std::isfinite(*value) || count == 3) {
      return std::nullopt;
    }
    out[count++] = *value;
  }
  return count == 3 ? std::optional(out) : std::nullopt;
}

std::string place(const std::string &file, const XmlElement &element) {
  return file + ":" + std::to_string(element.line) + ": ";
}

base::Result<Fixed> origin_of(const XmlElement &joint, const std::string &where) {
  const XmlElement *origin = joint.child("origin");
  if (origin == nullptr) {
    return Fixed();
  }
  const auto xyz = three(origin->attribute("xyz"), Eigen::Vector3d::Zero());
  const auto rpy = three(origin->attribute("rpy"), Eigen::Vector3d::Zero());
  if (!xyz || !rpy) {
    return base::failure(where + "its origin must be three numbers each in xyz and rpy");
  }
  const Eigen::Quaterniond R = Eigen::AngleAxisd(rpy->z(), Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(rpy->y(), Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(rpy->x(), Eigen::Vector3d::UnitX());
  return Fixed(R, kMillimetresPerMetre * *xyz);
}

base::Result<robot::JointLimits> limits_of(const XmlElement &joint, bool continuous, const std::string &where) {
  if (continuous) {
    return robot::JointLimits{-2.0 * std::numbers::pi, 2.0 * std::numbers::pi};
  }
  const XmlElement *limit = joint.child("limit");
  if (limit == nullptr) {
    return base::failure(where + "a revolute joint needs a limit");
  }
  const auto lower = base::parsed_number<double>(base::trimmed(limit->attribute("lower")));
  const auto upper = base::parsed_number<double>(base::trimmed(limit->attribute("upper")));
  if (!lower || !upper || !(*lower < *upper) || !std::isfinite(*lower) || !std::isfinite(*upper)) {
    return base::failure(where + "its limit needs lower and upper, in rad, lower first");
  }
  return robot::JointLimits{*lower, *upper};
}

base::Result<UrdfJoint> joint_of(const XmlElement &element, const std::string &file) {
  UrdfJoint out;
  out.name = element.attribute("name");
  const std::string where = place(file, element) + "joint \"" + out.name + "\": ";
  const std::string_view type = element.attribute("type");
  out.moves = type == "revolute" || type == "continuous";
  if (!out.moves && type != "fixed") {
    return tl::unexpected(
        base::Error{where + "type \"" + std::string(type) + "\" is not revolute, continuous or fixed"});
  }
  const XmlElement *parent = element.child("parent");
  const XmlElement *child = element.child("child");
  if (parent == nullptr || child == nullptr) {
    return base::failure(where + "it needs a parent and a child");
  }
  out.parent = parent->attribute("link");
  out.child = child->attribute("link");
  const auto origin = origin_of(element, where);
  if (!origin) {
    return tl::unexpected(origin.error());
  }
  out.T_parent_joint = *origin;
  if (!out.moves) {
    return out;
  }
  const XmlElement *axis = element.child("axis");
  const auto direction = three(axis == nullptr ? "" : axis->attribute("xyz"), Eigen::Vector3d::UnitX());
  if (!direction || !(direction->norm() > 0.0)) {
    return base::failure(where + "its axis has no direction");
  }
  out.axis = *direction;
  const auto limits = limits_of(element, type == "continuous", where);
  if (!limits) {
    return tl::unexpected(limits.error());
  }
  out.limits = *limits;
  return out;
}

// The joints from the root to a link, by the joint above each link.
using JointAbove = std::map<std::string, UrdfJoint, std::less<>>;
std::vector<const UrdfJoint *> chain_to(const std::string &link, const JointAbove &above) {
  std::vector<const UrdfJoint *> out;
  for (auto at = above.find(link); at != above.end() && out.size() <= above.size();
       at = above.find(at->second.parent)) {
    out.push_back(&at->second);
  }
  std::reverse(out.begin(), out.end());
  return out;
}

std::size_t moving(const std::vector<const UrdfJoint *> &chain) {
  return static_cast<std::size_t>(
      std::count_if(chain.begin(), chain.end(), [](const UrdfJoint *joint) { return joint->moves; }));
}

base::Result<robot::ArmModel> arm_of(const std::string &name, const std::vector<const UrdfJoint *> &chain,
                                     const std::string &file) {
  std::array<robot::ChainJoint, robot::kJoints> joints;
  std::array<robot::JointLimits, robot::kJoints> limits;
  geometry::Rigid3<geometry::frame::Target, geometry::frame::Target> T; // since the last moving joint
  std::size_t count = 0;
  for (const UrdfJoint *joint : chain) {
    T = T * joint->T_parent_joint.as<geometry::frame::Target, geometry::frame::Target>();
    if (joint->moves) {
      joints[count] = {T.as<geometry::frame::Target, geometry::frame::Source>(), joint->axis};
      limits[count++] = joint->limits;
      T = {};
    }
  }
  try {
    return robot::ArmModel::from_chain(name, joints, limits, T.as<geometry::frame::Target, geometry::frame::Source>());
  } catch (const std::invalid_argument &problem) {
    return base::failure(file + ": " + problem.what());
  }
}

} // namespace

base::Result<robot::ArmModel> parse_urdf_arm(std::string_view text, const std::string &name) {
  const auto root = detail::parse_xml(text);
  if (!root) {
    return base::failure(name + (root.error().line > 0 ? ":" + std::to_string(root.error().line) : "") + ": " +
                         root.error().what);
  }
  if (root->name != "robot") {
    return base::failure(name + ": the outermost element is \"" + root->name + "\", not \"robot\"");
  }
  JointAbove above;
  for (const XmlElement &element : root->children) {
    if (element.name != "joint") {
      continue;
    }
    auto joint = joint_of(element, name);
    if (!joint) {
      return tl::unexpected(joint.error());
    }
    const std::string child = joint->child;
    if (!above.emplace(child, std::move(*joint)).second) {
      return base::failure(place(name, element) + "link \"" + child + "\" is the child of two joints");
    }
  }
  std::vector<const UrdfJoint *> found;
  int ends = 0;
  for (const auto &[link, joint] : above) {
    const bool is_end = std::none_of(above.begin(), above.end(),
                                     [&wanted = link](const auto &other) { return other.second.parent == wanted; });
    auto chain = chain_to(link, above);
    if (is_end && chain.size() <= above.size() && moving(chain) == robot::kJoints) {
      found = std::move(chain);
      ++ends;
    }
  }
  if (ends != 1) {
    return base::failure(name + ": " + std::to_string(ends) +
                         " ends of the tree have six moving joints before them, exactly one is needed");
  }
  return arm_of(std::string(root->attribute("name")), found, name);
}

} // namespace bregma::casefile
