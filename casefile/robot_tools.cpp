#include "casefile/robot_tools.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <utility>

#include <Eigen/Eigenvalues>
#include <nlohmann/json.hpp>

#include "algorithms/geometry/angles.hpp"
#include "base/read_file.hpp"
#include "base/table_reader.hpp"
#include "casefile/dh_arm.hpp"
#include "casefile/range_curve.hpp"

namespace bregma::casefile {

namespace {

constexpr std::size_t kMaxName = 31; // bytes, as on the wire
constexpr double kMinAxisLength = 1e-6;

using nlohmann::json;

// A calibration as `bregma calibrate ... --json` prints it. What was refused there is refused here.
base::Result<json> read_calibration(const std::filesystem::path &file, std::string_view verb) {
  std::ifstream stream(file);
  json out = json::parse(stream, nullptr, false);
  if (!stream.is_open() || !out.is_object() || !out.contains("accepted")) {
    return base::failure(file.string() + ": is no result of `bregma calibrate " + std::string(verb) + " --json`");
  }
  if (out["accepted"] != true) {
    return base::failure(file.string() + ": this calibration was refused" +
                         (out["text"].is_string() ? ": " + out["text"].get<std::string>() : std::string()));
  }
  return out;
}

template <int Rows, int Columns> Eigen::Matrix<double, Rows, Columns> numbers_of(const json &value) {
  Eigen::Matrix<double, Rows, Columns> out;
  for (int row = 0; row < Rows; ++row) {
    for (int column = 0; column < Columns; ++column) {
      const json &cell = value.at(static_cast<std::size_t>(row));
      out(row, column) = (Columns == 1 ? cell : cell.at(static_cast<std::size_t>(column))).get<double>();
    }
  }
  return out;
}

bool is_covariance(const Eigen::MatrixXd &matrix) {
  constexpr double kRounding = 1e-9; // of the largest entry
  const double largest = matrix.cwiseAbs().maxCoeff();
  return matrix.allFinite() && (matrix - matrix.transpose()).cwiseAbs().maxCoeff() <= kRounding * largest &&
         Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(matrix).eigenvalues().minCoeff() >= -kRounding * largest;
}

base::Result<void> read_beam(const std::filesystem::path &file, RangeSensorModel &sensor) {
  const auto document = read_calibration(file, "beam");
  if (!document) {
    return tl::unexpected(document.error());
  }
  try {
    sensor.origin_mm = numbers_of<3, 1>(document->at("origin_mm"));
    sensor.direction = numbers_of<3, 1>(document->at("direction"));
    sensor.covariance = numbers_of<6, 6>(document->at("covariance"));
  } catch (const json::exception &) {
    return base::failure(file.string() + ": origin_mm, direction or covariance is missing");
  }
  if (!sensor.origin_mm.allFinite() || !(std::abs(sensor.direction.norm() - 1.0) < 1e-3) ||
      !is_covariance(sensor.covariance)) {
    return base::failure(file.string() + ": is no beam: the direction has no unit length, covariance is none, or a "
                                         "number is invalid");
  }
  sensor.direction.normalize();
  return {};
}

base::Result<void> read_curve(const std::filesystem::path &file, RangeSensorModel &sensor) {
  auto curve = read_range_curve(file);
  if (!curve) {
    return tl::unexpected(curve.error());
  }
  if (!(curve->law.exponent > 0.0)) {
    return base::failure(file.string() + ": is the curve of a voltage: it belongs to the driver (curve.scale_mm, "
                                         "curve.exponent); here the readings are the driver's distances");
  }
  if (curve->covariance.isZero() || !is_covariance(curve->covariance)) {
    return base::failure(file.string() + ": is no curve: covariance must be there and a covariance");
  }
  if (curve->corrections.size() > kMaxCurveCorrections) {
    return base::failure(file.string() + ": corrections: has " + std::to_string(curve->corrections.size()) +
                         ", at most " + std::to_string(kMaxCurveCorrections) + " are known");
  }
  sensor.curve = std::move(*curve);
  return {};
}

template <class Target, class Source>
bool read_pose(const Eigen::Matrix4d &matrix, geometry::Rigid3<Target, Source> &out) {
  constexpr double kRounding = 1e-6;
  const Eigen::Matrix3d R = matrix.topLeftCorner<3, 3>();
  if (!matrix.allFinite() || !((R * R.transpose()).isIdentity(kRounding)) || !(R.determinant() > 0.0) ||
      !(matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).isZero(kRounding)) {
    return false;
  }
  out = {R, Eigen::Vector3d(matrix.topRightCorner<3, 1>())};
  return true;
}

base::Result<void> read_hand_eye_file(const std::filesystem::path &file, HandEyeModel &out) {
  const auto document = read_calibration(file, "hand-eye");
  if (!document) {
    return tl::unexpected(document.error());
  }
  if (!document->contains("Y")) {
    return base::failure(file.string() + ": is made from motions alone (A X = X B), which do not tell where the "
                                         "tracker stands");
  }
  Eigen::Matrix4d X, Y;
  try {
    X = numbers_of<4, 4>(document->at("X"));
    Y = numbers_of<4, 4>(document->at("Y"));
    out.joint = numbers_of<12, 12>(document->at("covariance_joint"));
  } catch (const json::exception &) {
    return base::failure(file.string() + ": X, Y or covariance_joint is missing, or has another size");
  }
  if (!read_pose(X, out.T_flange_body.pose) || !read_pose(Y, out.T_base_tracker.pose) || !is_covariance(out.joint)) {
    return base::failure(file.string() + ": X or Y is no rigid motion, or covariance_joint is no covariance");
  }
  out.T_flange_body.covariance = out.joint.topLeftCorner<6, 6>();
  out.T_base_tracker.covariance = out.joint.bottomRightCorner<6, 6>();
  return {};
}

HandEyeModel read_hand_eye(base::TableReader &table, const std::filesystem::path &folder) {
  HandEyeModel out;
  const std::string file = table.require_string("file");
  out.tracker = table.require_string("tracker");
  out.flange_body = table.string("flange_body", "");
  if (out.tracker.empty() || out.tracker.size() > kMaxName) {
    table.refuse("tracker", "must have 1 to 31 bytes");
  }
  if (const auto read = file.empty() ? base::Result<void>() : read_hand_eye_file(folder / file, out); !read) {
    table.refuse("file", read.error().message);
  }
  return out;
}

RangeSensorModel read_sensor(base::TableReader &table, const std::filesystem::path &folder) {
  RangeSensorModel sensor;
  sensor.name = table.require_string("name");
  const std::string beam = table.require_string("beam");
  const std::string curve = table.string("curve", "");
  sensor.window = table.integer("window", sensor.window, "readings", 1, 1000);
  sensor.delay_ms = table.number("delay_ms", sensor.delay_ms, "ms", 0.0, 1000.0);
  sensor.sigma_mm = table.number("sigma_mm", sensor.sigma_mm, "mm", 0.0, 100.0);
  sensor.near_mm = table.number("near_mm", sensor.near_mm, "mm", 0.0, 1e4);
  sensor.far_mm = table.number("far_mm", sensor.far_mm, "mm", 1.0, 1e4);
  sensor.radius_mm = table.number("radius_mm", sensor.radius_mm, "mm", 0.5, 500.0);
  sensor.excess_mm = table.number("excess_mm", sensor.excess_mm, "mm", 0.0, 50.0);
  if (sensor.near_mm >= sensor.far_mm) {
    table.refuse("near_mm", "must be below far_mm");
  }
  if (const auto read = beam.empty() ? base::Result<void>() : read_beam(folder / beam, sensor); !read) {
    table.refuse("beam", read.error().message);
  }
  if (const auto read = curve.empty() ? base::Result<void>() : read_curve(folder / curve, sensor); !read) {
    table.refuse("curve", read.error().message);
  }
  return sensor;
}

void read_links(base::TableReader &root, const std::filesystem::path &folder, RobotEquipment &out) {
  const std::string arm = root.string("arm", "");
  out.table_z_mm = root.optional_number("table_mm", "mm", -1e4, 1e4);
  if (arm.empty()) {
    return;
  }
  const auto text = base::read_file(folder / arm);
  auto links =
      text ? parse_dh_arm(*text, (folder / arm).string()) : base::Result<robot::ArmModel>(tl::unexpected(text.error()));
  if (!links) {
    root.refuse("arm", links.error().message);
    return;
  }
  out.arm = std::move(*links);
}

template <class Item> void check_name(base::TableReader &table, const Item &item, const std::vector<Item> &others) {
  if (item.name.empty() || item.name.size() > kMaxName) {
    table.refuse("name", "must have 1 to 31 bytes");
  }
  if (std::any_of(others.begin(), others.end(), [&](const Item &other) { return other.name == item.name; })) {
    table.refuse("name", "appears twice");
  }
}

} // namespace

base::Result<RobotEquipment> read_robot_equipment(const std::filesystem::path &file) {
  const auto document = base::TomlDocument::read(file);
  if (!document) {
    return tl::unexpected(document.error());
  }
  base::TableReader root = document->root();
  RobotEquipment out;
  read_links(root, file.parent_path(), out);
  for (base::TableReader &table : root.tables("tools")) {
    RobotToolModel tool;
    tool.name = table.require_string("name");
    tool.tip_mm = table.require_vector3("tip_mm");
    tool.axis = table.vector3("axis", tool.axis);
    tool.sigma_mm = table.require_number("sigma_mm", "mm", 0.001, 10.0);
    tool.sigma_rad = table.number("sigma_deg", 0.0, "deg", 0.0, 10.0) * geometry::kRadiansPerDegree;
    tool.radius_mm = table.number("radius_mm", tool.radius_mm, "mm", 0.5, 500.0);
    check_name(table, tool, out.tools);
    if (tool.axis.norm() < kMinAxisLength) {
      table.refuse("axis", "has no length");
    }
    tool.axis.normalize();
    if (auto ok = table.finish(); !ok) {
      return tl::unexpected(ok.error());
    }
    out.tools.push_back(std::move(tool));
  }
  for (base::TableReader &table : root.tables("sensors")) {
    RangeSensorModel sensor = read_sensor(table, file.parent_path());
    check_name(table, sensor, out.sensors);
    if (auto ok = table.finish(); !ok) {
      return tl::unexpected(ok.error());
    }
    out.sensors.push_back(std::move(sensor));
  }
  if (auto table = root.table("hand_eye")) {
    out.hand_eye = read_hand_eye(*table, file.parent_path());
    if (auto ok = table->finish(); !ok) {
      return tl::unexpected(ok.error());
    }
  }
  if (out.tools.empty()) {
    root.refuse("tools", "at least one is needed");
  }
  if (auto ok = root.finish(); !ok) {
    return tl::unexpected(ok.error());
  }
  return out;
}

} // namespace bregma::casefile
