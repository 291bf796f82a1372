#include "casefile/itk_transform.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "base/read_file.hpp"
#include "base/text.hpp"
#include "base/write_file.hpp"
#include "casefile/pose_text.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;
using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr std::string_view kFirstLine = "#Insight Transform File V1.0";
constexpr double kMinDeterminant = 1e-9;
constexpr double kMaxResidual = 1e-6; // of a matrix times its inverse, mm

// Converts from RAS to LPS and from LPS to RAS.
Matrix4d flip() { return Eigen::Vector4d(-1.0, -1.0, 1.0, 1.0).asDiagonal(); }

// Empty where the matrix cannot be inverted in double precision: it is singular, or it or its inverse overflows.
std::optional<Matrix4d> inverse_of(const Matrix4d &T) {
  if (!T.allFinite() || !(std::abs(T.topLeftCorner<3, 3>().determinant()) > kMinDeterminant)) {
    return std::nullopt;
  }
  const Matrix4d inverse = T.inverse();
  const double residual = (T * inverse - Matrix4d::Identity()).cwiseAbs().maxCoeff();
  return inverse.allFinite() && residual < kMaxResidual ? std::optional(inverse) : std::nullopt;
}

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
  std::string missing; // from a text that is not whole
};

constexpr std::string_view kComposite = "CompositeTransform";

base::Result<Content> read_text(const std::string &file, std::string_view all) {
  Content out;
  int number = 0;
  const bool ends = all.ends_with('\n');
  while (!all.empty()) {
    const std::size_t end = std::min(all.find('\n'), all.size());
    const std::string_view text = base::trimmed(all.substr(0, end));
    all.remove_prefix(std::min(end + 1, all.size()));
    const std::string place = file + ":" + std::to_string(++number) + ": ";
    if (number == 1 && !text.starts_with(kFirstLine)) {
      return base::failure(place + "is not an ITK transform file: it must begin with \"" + std::string(kFirstLine) +
                           "\", or be a .mat file of ANTs");
    }
    if (text.empty() || text.front() == '#') {
      continue;
    }
    const std::size_t colon = text.find(':');
    const std::string_view key = base::trimmed(text.substr(0, colon));
    const std::string_view value = colon == std::string_view::npos ? "" : base::trimmed(text.substr(colon + 1));
    if (key == "Transform") {
      if (out.type.empty() && value.starts_with(kComposite)) {
        continue; // of one, or the next transform is a second one
      }
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
      if ((fixed ? out.fixed_line : out.parameters_line) > 0) {
        return base::failure(place + std::string(key) + ": is stated a second time");
      }
      (fixed ? out.fixed : out.parameters) = std::move(*numbers);
      (fixed ? out.fixed_line : out.parameters_line) = number;
    } else {
      return base::failure(place + "\"" + std::string(key) + "\" is not part of a transform");
    }
  }
  if (out.type.empty()) {
    return base::failure(file + ": holds no transform");
  }
  // The numbers of the last line are those of the centre: without its end, digits may be missing.
  out.missing = out.fixed_line == 0 ? "it has no FixedParameters" : ends ? "" : "its last line does not end";
  return out;
}

// MATLAB level 4: matrices of doubles or floats, each with a header of five 32-bit integers and a name. ITK writes the
// parameters under the transform's type, then the fixed parameters under "fixed". Little endian only.
class MatFile {
public:
  MatFile(std::string file, std::string_view bytes) : file_(std::move(file)), left_(bytes) {}

  // Every such file begins with the type of its first matrix: little endian, by columns, 0 double or 10 float.
  static bool is_one(std::string_view bytes) {
    return bytes.size() >= 4 && (bytes[0] == 0 || bytes[0] == 10) && bytes[1] == 0 && bytes[2] == 0 && bytes[3] == 0;
  }

  base::Result<Content> read() {
    Content out;
    while (!left_.empty()) {
      std::string name;
      auto values = read_matrix(name);
      if (!values) {
        return tl::unexpected(values.error());
      }
      const bool fixed = name == "fixed";
      if (!fixed && !out.type.empty()) {
        return base::failure(file_ + ": holds a second transform (" + name + "), only one is read");
      }
      (fixed ? out.fixed : out.parameters) = std::move(*values);
      out.type = fixed ? out.type : name;
    }
    return out.type.empty() ? base::Result<Content>(base::failure(file_ + ": holds no transform")) : out;
  }

private:
  template <class Number> Number take() {
    Number out{};
    std::memcpy(&out, left_.data(), sizeof out);
    left_.remove_prefix(sizeof out);
    return out;
  }

  base::Result<std::vector<double>> read_matrix(std::string &name) {
    static_assert(std::endian::native == std::endian::little);
    const auto not_whole = [this](std::uint64_t needed) {
      return base::failure(file_ + ": is not whole: a matrix has " + std::to_string(left_.size()) + " of " +
                           std::to_string(needed) + " bytes");
    };
    constexpr std::size_t kHeader = 5 * sizeof(std::int32_t);
    constexpr std::int64_t kMost = 1000; // of rows, columns and letters, in a transform
    if (left_.size() < kHeader) {
      return not_whole(kHeader);
    }
    const auto type = take<std::int32_t>();
    const std::int64_t rows = take<std::int32_t>();
    const std::int64_t columns = take<std::int32_t>();
    const auto imaginary = take<std::int32_t>();
    const std::int64_t letters = take<std::int32_t>();
    if ((type != 0 && type != 10) || imaginary != 0 || rows < 1 || rows > kMost || columns != 1 || letters < 1 ||
        letters > kMost) {
      return base::failure(file_ + ": is no .mat file of a transform (level 4)");
    }
    const std::size_t each = type == 0 ? sizeof(double) : sizeof(float);
    const auto needed = static_cast<std::uint64_t>(letters) + static_cast<std::uint64_t>(rows) * each;
    if (left_.size() < needed) {
      return not_whole(needed);
    }
    name = left_.substr(0, static_cast<std::size_t>(letters));
    name.resize(std::min(name.find('\0'), name.size()));
    left_.remove_prefix(static_cast<std::size_t>(letters));
    std::vector<double> out;
    for (std::int64_t i = 0; i < rows; ++i) {
      out.push_back(type == 0 ? take<double>() : static_cast<double>(take<float>()));
      if (!std::isfinite(out.back())) {
        return base::failure(file_ + ": " + name + ": number " + std::to_string(i + 1) + " is not finite");
      }
    }
    return out;
  }

  std::string file_;
  std::string_view left_;
};

base::Result<Content> read_content(const fs::path &file) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 20;
  const auto bytes = base::read_file(file, kMaxBytes);
  if (!bytes) {
    return tl::unexpected(bytes.error());
  }
  return MatFile::is_one(*bytes) ? MatFile(file.string(), *bytes).read() : read_text(file.string(), *bytes);
}

// Rotation of Euler3DTransform: about z, x, y, or z, y, x if the last fixed parameter is set (itkEuler3DTransform.hxx).
Matrix3d euler(const Vector3d &angles_rad, bool zyx) {
  const Matrix3d x = Eigen::AngleAxisd(angles_rad.x(), Vector3d::UnitX()).toRotationMatrix();
  const Matrix3d y = Eigen::AngleAxisd(angles_rad.y(), Vector3d::UnitY()).toRotationMatrix();
  const Matrix3d z = Eigen::AngleAxisd(angles_rad.z(), Vector3d::UnitZ()).toRotationMatrix();
  return zyx ? Matrix3d(z * y * x) : Matrix3d(z * x * y);
}

constexpr std::array<std::string_view, 9> kKinds{
    "AffineTransform",  "MatrixOffsetTransformBase", "Rigid3DTransform",
    "Euler3DTransform", "VersorRigid3DTransform",    "Similarity3DTransform",
    "VersorTransform",  "QuaternionRigidTransform",  "TranslationTransform"};

struct LinearPart {
  Matrix3d matrix;
  Vector3d translation;
};

// The vector part of a unit quaternion whose scalar part is not negative.
std::optional<Matrix3d> rotation_of_versor(const Vector3d &versor) {
  const double squared = versor.squaredNorm();
  if (squared > 1.0 + 1e-12) {
    return std::nullopt;
  }
  const double scalar = std::sqrt(std::max(0.0, 1.0 - squared));
  return Eigen::Quaterniond(scalar, versor.x(), versor.y(), versor.z()).normalized().toRotationMatrix();
}

std::optional<LinearPart> linear_part(const Content &content, std::string_view kind) {
  const std::vector<double> &p = content.parameters;
  if (kind == "AffineTransform" || kind == "MatrixOffsetTransformBase" || kind == "Rigid3DTransform") {
    if (p.size() != 12) {
      return std::nullopt;
    }
    return LinearPart{Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(p.data()), Vector3d(p.data() + 9)};
  }
  if (kind == "TranslationTransform") {
    return p.size() == 3 ? std::optional(LinearPart{Matrix3d::Identity(), Vector3d(p.data())}) : std::nullopt;
  }
  if (kind == "QuaternionRigidTransform") { // x, y, z, w
    const bool whole = p.size() == 7;
    const Eigen::Quaterniond q = whole ? Eigen::Quaterniond(p[3], p[0], p[1], p[2]) : Eigen::Quaterniond::Identity();
    return whole && std::abs(q.norm() - 1.0) < kRigidTolerance
               ? std::optional(LinearPart{q.normalized().toRotationMatrix(), Vector3d(p.data() + 4)})
               : std::nullopt;
  }
  // The rotation, the translation but for VersorTransform, and the scale of Similarity3DTransform.
  const bool scaled = kind == "Similarity3DTransform", turns_only = kind == "VersorTransform";
  if (p.size() != (scaled ? 7U : turns_only ? 3U : 6U)) {
    return std::nullopt;
  }
  const Vector3d first(p.data());
  const Vector3d translation = turns_only ? Vector3d(Vector3d::Zero()) : Vector3d(p.data() + 3);
  if (kind == "Euler3DTransform") {
    const bool zyx = content.fixed.size() == 4 && content.fixed[3] != 0.0;
    return LinearPart{euler(first, zyx), translation};
  }
  const auto rotation = rotation_of_versor(first);
  return rotation ? std::optional(LinearPart{Matrix3d((scaled ? p[6] : 1.0) * *rotation), translation}) : std::nullopt;
}

} // namespace

base::Result<void> write_itk_transform(const fs::path &file, const Matrix4d &T_target_source) {
  const auto inverse = inverse_of(T_target_source);
  if (!inverse || T_target_source.row(3) != Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0)) {
    return base::failure(file.string() + ": not written: the transform has no inverse");
  }
  const Matrix4d moving_fixed = flip() * *inverse * flip();
  std::string out = std::string(kFirstLine) + "\n#Transform 0\nTransform: AffineTransform_double_3_3\nParameters:";
  for (Eigen::Index row = 0; row < 3; ++row) {
    for (Eigen::Index column = 0; column < 3; ++column) {
      out += " " + exact(moving_fixed(row, column));
    }
  }
  for (Eigen::Index row = 0; row < 3; ++row) {
    out += " " + exact(moving_fixed(row, 3));
  }
  return base::write_file(file, out + "\nFixedParameters: 0 0 0\n");
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
  if (std::find(kKinds.begin(), kKinds.end(), kind) == kKinds.end() ||
      (scalars != "_double_3_3" && scalars != "_float_3_3")) {
    std::string names;
    for (const std::string_view name : kKinds) {
      names += (names.empty() ? "" : ", ") + std::string(name);
    }
    return base::failure(place(content->type_line) + "Transform: " + content->type +
                         ": is not read; read are transforms of three dimensions (_double_3_3, _float_3_3): " + names);
  }
  if (!content->missing.empty()) {
    return base::failure(file.string() + ": is not whole: " + content->missing);
  }
  const bool centred = kind != "TranslationTransform";
  if (content->fixed.size() != (centred ? 3 : 0) && !(kind == "Euler3DTransform" && content->fixed.size() == 4)) {
    return base::failure(place(content->fixed_line) + "FixedParameters: " + std::to_string(content->fixed.size()) +
                         " numbers, the centre has 3");
  }
  const auto linear = linear_part(*content, kind);
  if (!linear) {
    return base::failure(place(content->parameters_line) + "Parameters: " + std::to_string(content->parameters.size()) +
                         " numbers that are no " + std::string(kind));
  }
  const Vector3d centre = centred ? Vector3d(content->fixed.data()) : Vector3d::Zero();
  Matrix4d moving_fixed = Matrix4d::Identity();
  moving_fixed.topLeftCorner<3, 3>() = linear->matrix;
  moving_fixed.topRightCorner<3, 1>() = linear->translation + centre - linear->matrix * centre;
  const auto fixed_moving = inverse_of(moving_fixed);
  if (!fixed_moving) {
    return base::failure(place(content->parameters_line) + "Parameters: the matrix has no inverse");
  }
  return Matrix4d(flip() * *fixed_moving * flip());
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
