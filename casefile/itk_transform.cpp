#include "casefile/itk_transform.hpp"

#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "base/text.hpp"
#include "casefile/pose_text.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;
using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr std::string_view kFirstLine = "#Insight Transform File V1.0";
constexpr double kMinDeterminant = 1e-9;

// Converts from RAS to LPS and from LPS to RAS.
Matrix4d flip() { return Eigen::Vector4d(-1.0, -1.0, 1.0, 1.0).asDiagonal(); }

// The shortest text that is read as the same number.
std::string exact(double value) {
  char buffer[32];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value + 0.0).ptr; // no negative zero
  return {buffer, end};
}

// Content of the file: y = matrix (x - centre) + centre + translation, in LPS.
struct Content {
  std::string type;
  std::vector<double> parameters, fixed;
  int type_line = 0, parameters_line = 0, fixed_line = 0;
};

base::Result<Content> read_content(const fs::path &file) {
  std::error_code error;
  std::ifstream in(file);
  if (!in || fs::is_directory(file, error)) {
    return base::failure(file.string() + ": no such file, or it cannot be read");
  }
  Content out;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::string place = file.string() + ":" + std::to_string(number) + ": ";
    const std::string_view text = base::trimmed(line);
    if (number == 1 && !text.starts_with(kFirstLine)) {
      return base::failure(place + "is not an ITK transform file: it must begin with \"" + std::string(kFirstLine) +
                           "\"");
    }
    if (text.empty() || text.front() == '#') {
      continue;
    }
    const std::size_t colon = text.find(':');
    const std::string_view key = base::trimmed(text.substr(0, colon));
    const std::string_view value = colon == std::string_view::npos ? "" : base::trimmed(text.substr(colon + 1));
    if (key == "Transform") {
      if (!out.type.empty()) {
        return base::failure(place + "is a second transform (" + std::string(value) + "), only one is read");
      }
      out.type = value;
      out.type_line = number;
    } else if (key == "Parameters" || key == "FixedParameters") {
      auto numbers = detail::parse_numbers(value);
      if (!numbers) {
        return base::failure(place + std::string(key) + ": " + numbers.error());
      }
      const bool fixed = key == "FixedParameters";
      (fixed ? out.fixed : out.parameters) = std::move(*numbers);
      (fixed ? out.fixed_line : out.parameters_line) = number;
    } else {
      return base::failure(place + "\"" + std::string(key) + "\" is not part of a transform");
    }
  }
  if (out.type.empty()) {
    return base::failure(file.string() + ": holds no transform");
  }
  return out;
}

// Rotation of Euler3DTransform: about z, x, y, or z, y, x if the last fixed parameter is set (itkEuler3DTransform.hxx).
Matrix3d euler(const Vector3d &angles_rad, bool zyx) {
  const Matrix3d x = Eigen::AngleAxisd(angles_rad.x(), Vector3d::UnitX()).toRotationMatrix();
  const Matrix3d y = Eigen::AngleAxisd(angles_rad.y(), Vector3d::UnitY()).toRotationMatrix();
  const Matrix3d z = Eigen::AngleAxisd(angles_rad.z(), Vector3d::UnitZ()).toRotationMatrix();
  return zyx ? Matrix3d(z * y * x) : Matrix3d(z * x * y);
}

struct LinearPart {
  Matrix3d matrix;
  Vector3d translation;
};

std::optional<LinearPart> linear_part(const Content &content, std::string_view kind) {
  const std::vector<double> &p = content.parameters;
  if (kind == "AffineTransform" || kind == "MatrixOffsetTransformBase") {
    if (p.size() != 12) {
      return std::nullopt;
    }
    return LinearPart{Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(p.data()), Vector3d(p.data() + 9)};
  }
  if (p.size() != 6) {
    return std::nullopt;
  }
  const Vector3d first(p.data());
  if (kind == "Euler3DTransform") {
    const bool zyx = content.fixed.size() == 4 && content.fixed[3] != 0.0;
    return LinearPart{euler(first, zyx), Vector3d(p.data() + 3)};
  }
  // VersorRigid3DTransform: the vector part of a unit quaternion whose scalar part is not negative.
  const double squared = first.squaredNorm();
  if (squared > 1.0 + 1e-12) {
    return std::nullopt;
  }
  const Eigen::Quaterniond versor(std::sqrt(std::max(0.0, 1.0 - squared)), first.x(), first.y(), first.z());
  return LinearPart{versor.normalized().toRotationMatrix(), Vector3d(p.data() + 3)};
}

} // namespace

base::Result<void> write_itk_transform(const fs::path &file, const Matrix4d &T_target_source) {
  if (!T_target_source.allFinite() || T_target_source.row(3) != Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0) ||
      !(std::abs(T_target_source.determinant()) > kMinDeterminant)) {
    return base::failure(file.string() + ": not written: the transform has no inverse");
  }
  const Matrix4d moving_fixed = flip() * T_target_source.inverse() * flip();
  std::string out = std::string(kFirstLine) + "\n#Transform 0\nTransform: AffineTransform_double_3_3\nParameters:";
  for (Eigen::Index row = 0; row < 3; ++row) {
    for (Eigen::Index column = 0; column < 3; ++column) {
      out += " " + exact(moving_fixed(row, column));
    }
  }
  for (Eigen::Index row = 0; row < 3; ++row) {
    out += " " + exact(moving_fixed(row, 3));
  }
  std::ofstream stream(file, std::ios::binary);
  stream << out << "\nFixedParameters: 0 0 0\n";
  stream.close();
  return stream ? base::Result<void>() : base::failure(file.string() + ": cannot be written");
}

base::Result<Matrix4d> read_itk_transform(const fs::path &file) {
  const auto content = read_content(file);
  if (!content) {
    return tl::unexpected(content.error());
  }
  const auto place = [&file](int line) {
    return file.string() + (line > 0 ? ":" + std::to_string(line) + ": " : ": ");
  };
  const std::string_view type = content->type;
  const std::string_view kind = type.substr(0, type.find('_'));
  const std::string_view scalars = type.substr(kind.size());
  const bool known = kind == "AffineTransform" || kind == "MatrixOffsetTransformBase" || kind == "Euler3DTransform" ||
                     kind == "VersorRigid3DTransform";
  if (!known || (scalars != "_double_3_3" && scalars != "_float_3_3")) {
    return base::failure(place(content->type_line) + "Transform: " + content->type +
                         ": only affine and rigid transforms of three dimensions are read");
  }
  if (content->fixed.size() != 3 && !(kind == "Euler3DTransform" && content->fixed.size() == 4)) {
    return base::failure(place(content->fixed_line) + "FixedParameters: " + std::to_string(content->fixed.size()) +
                         " numbers, the centre has 3");
  }
  const auto linear = linear_part(*content, kind);
  if (!linear) {
    return base::failure(place(content->parameters_line) + "Parameters: " + std::to_string(content->parameters.size()) +
                         " numbers that are no " + std::string(kind));
  }
  const Vector3d centre(content->fixed.data());
  Matrix4d moving_fixed = Matrix4d::Identity();
  moving_fixed.topLeftCorner<3, 3>() = linear->matrix;
  moving_fixed.topRightCorner<3, 1>() = linear->translation + centre - linear->matrix * centre;
  if (!(std::abs(linear->matrix.determinant()) > kMinDeterminant) || !moving_fixed.allFinite()) {
    return base::failure(place(content->parameters_line) + "Parameters: the matrix has no inverse");
  }
  return Matrix4d(flip() * moving_fixed.inverse() * flip());
}

base::Result<TargetFromSource> read_itk_rigid(const fs::path &file) {
  const auto T = read_itk_transform(file);
  if (!T) {
    return tl::unexpected(T.error());
  }
  const Matrix3d A = T->topLeftCorner<3, 3>();
  if ((A * A.transpose() - Matrix3d::Identity()).norm() > kRigidTolerance || A.determinant() < 0.0) {
    return base::failure(file.string() + ": the transform is not rigid: it scales, shears or mirrors (determinant " +
                         exact(A.determinant()) + ")");
  }
  return TargetFromSource(A, T->topRightCorner<3, 1>());
}

} // namespace bregma::casefile
