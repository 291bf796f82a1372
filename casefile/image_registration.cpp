#include "casefile/image_registration.hpp"

#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

#include <Eigen/LU>
#include <nlohmann/json.hpp>

#include "base/read_file.hpp"
#include "casefile/itk_transform.hpp"
#include "casefile/sha256.hpp"

namespace bregma::casefile {

namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxResultBytes = std::size_t{4} << 20;
constexpr double kSamePosition_mm = 0.01;

// Members of a JSON object. The first problem is kept, and reading continues, so that it is straight code.
class Members {
public:
  Members(const Json &object, std::string place) : object_(object), place_(std::move(place)) {}

  std::string text(const char *key) {
    const Json *value = find(key);
    if (value != nullptr && value->is_string()) {
      return value->get<std::string>();
    }
    refuse(key, "must be a text");
    return {};
  }
  template <int N> Eigen::Matrix<double, N, N> matrix(const char *key) {
    Eigen::Matrix<double, N, N> out = Eigen::Matrix<double, N, N>::Identity();
    const Json *rows = find(key);
    bool good = rows != nullptr && rows->is_array() && rows->size() == N;
    for (std::size_t row = 0; good && row < N; ++row) {
      good = (*rows)[row].is_array() && (*rows)[row].size() == N;
      for (std::size_t column = 0; good && column < N; ++column) {
        const Json &cell = (*rows)[row][column];
        good = cell.is_number();
        if (good) {
          out(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column)) = cell.get<double>();
        }
      }
    }
    if (!good || !out.allFinite()) {
      refuse(key, "must be a matrix of " + std::to_string(N) + " x " + std::to_string(N) + " finite numbers");
    }
    return out;
  }
  ImageIdentity identity(const char *key) {
    ImageIdentity out;
    const Json *value = find(key);
    if (value == nullptr || !value->is_object()) {
      refuse(key, "must state an image");
      return out;
    }
    Members image(*value, place_ + key + ".");
    out.voxels_sha256 = image.text("voxels_sha256");
    out.T_ras_voxel = image.matrix<4>("T_ras_voxel");
    const Json *size = image.find("size");
    bool good = size != nullptr && size->is_array() && size->size() == 3;
    for (std::size_t d = 0; good && d < 3; ++d) {
      good = (*size)[d].is_number_unsigned() && (*size)[d].get<std::uint64_t>() <= std::numeric_limits<int>::max();
      out.size[d] = good ? (*size)[d].get<int>() : 0;
    }
    if (!good) {
      image.refuse("size", "must be three numbers of voxels");
    }
    problem_ = problem_.empty() ? image.problem_ : problem_;
    return out;
  }
  void refuse(const char *key, const std::string &what) {
    problem_ = problem_.empty() ? place_ + key + ": " + what : problem_;
  }
  [[nodiscard]] const std::string &problem() const { return problem_; }

private:
  const Json *find(const char *key) const {
    const auto at = object_.find(key);
    return at == object_.end() ? nullptr : &*at;
  }

  const Json &object_;
  std::string place_, problem_;
};

} // namespace

ImageIdentity identity_of(const image::Image<float, 3> &volume) {
  return {volume.size, volume.T_image_index, to_hex(sha256(std::as_bytes(std::span(volume.voxels))))};
}

std::optional<std::string> difference(const ImageIdentity &a, const ImageIdentity &b) {
  if (a.size != b.size) {
    return "they have different numbers of voxels";
  }
  if (a.voxels_sha256 != b.voxels_sha256) {
    return "their voxels differ";
  }
  for (int corner = 0; corner < 8; ++corner) {
    Eigen::Vector4d index = Eigen::Vector4d::UnitW();
    for (int d = 0; d < 3; ++d) {
      index[d] = (corner >> d & 1) != 0 ? a.size[static_cast<std::size_t>(d)] - 1 : 0;
    }
    if (!(((a.T_ras_voxel - b.T_ras_voxel) * index).norm() <= kSamePosition_mm)) {
      return "their voxels are at different positions";
    }
  }
  return std::nullopt;
}

base::Result<ImageRegistration> read_image_registration(const std::filesystem::path &file) {
  const auto content = base::read_file(file, kMaxResultBytes);
  if (!content) {
    return tl::unexpected(content.error());
  }
  const Json document = Json::parse(*content, nullptr, false);
  if (!document.is_object()) {
    return base::failure(file.string() + ": is not a result of bregma image register: it is not a JSON object");
  }
  Members members(document, file.string() + ": ");
  ImageRegistration out;
  const Eigen::Matrix4d T = members.matrix<4>("T_target_source");
  const Eigen::Matrix3d R = T.topLeftCorner<3, 3>();
  if (T.row(3) != Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0) ||
      !((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() <= kRigidTolerance) || R.determinant() < 0.0) {
    members.refuse("T_target_source", "is not rigid: an image of a case has the shape of the head");
  }
  out.T_image_source.pose = {R, T.topRightCorner<3, 1>()};
  const geometry::Matrix6d covariance = members.matrix<6>("covariance");
  out.T_image_source.covariance = 0.5 * (covariance + covariance.transpose());
  out.measure = members.text("measure");
  out.verdict = members.text("verdict");
  out.date = members.text("date");
  out.source = members.identity("source");
  out.target = members.identity("target");
  if (!members.problem().empty()) {
    return base::failure(members.problem());
  }
  return out;
}

} // namespace bregma::casefile
