#include "casefile/volumes/label_check.hpp"

#include <algorithm>
#include <cstdint>
#include <map>

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace bregma::casefile {
namespace {

constexpr double kMostOutside = 0.02; // fraction of labelled voxels outside of the image

struct Region {
  std::int64_t voxels = 0;
  double sum_x_mm = 0.0;
  [[nodiscard]] double centre_x_mm() const { return sum_x_mm / static_cast<double>(voxels); }
};

struct Census {
  std::map<int, Region> regions;
  std::int64_t voxels = 0, outside = 0; // of the labels; outside of the image
};

Census count(const LabelVolume &labels, const Volume &image) {
  const Eigen::Matrix4d T_index_label = image.T_image_index.inverse() * labels.T_image_index;
  const Eigen::Array3d last(image.size[0] - 0.5, image.size[1] - 0.5, image.size[2] - 0.5);
  Census out;
  for (int k = 0; k < labels.size[2]; ++k) {
    for (int j = 0; j < labels.size[1]; ++j) {
      for (int i = 0; i < labels.size[0]; ++i) {
        const int label = labels.at(i, j, k);
        if (label == 0) {
          continue;
        }
        const Eigen::Vector4d at(i, j, k, 1.0);
        const Eigen::Array3d index = (T_index_label * at).head<3>().array();
        Region &region = out.regions[label];
        ++region.voxels;
        region.sum_x_mm += labels.T_image_index.row(0).dot(at);
        ++out.voxels;
        out.outside += (index < -0.5).any() || (index > last).any() ? 1 : 0;
      }
    }
  }
  return out;
}

// Regions whose names say a side, against the plane between all of the left and all of the right.
std::string side_doubt(const Census &census, const LabelNames &names) {
  std::vector<std::pair<double, Side>> sided;
  double sum[2] = {0.0, 0.0};
  int count[2] = {0, 0};
  for (const auto &[label, region] : census.regions) {
    const auto name = names.find(label);
    const auto side = name != names.end() ? side_named(name->second) : std::nullopt;
    if (!side) {
      continue;
    }
    sided.emplace_back(region.centre_x_mm(), *side);
    sum[*side == Side::kLeft ? 0 : 1] += region.centre_x_mm();
    ++count[*side == Side::kLeft ? 0 : 1];
  }
  if (count[0] == 0 || count[1] == 0) {
    return "";
  }
  const double middle = 0.5 * (sum[0] / count[0] + sum[1] / count[1]);
  const auto wrong = std::count_if(sided.begin(), sided.end(), [middle](const auto &region) {
    return (region.first > middle) == (region.second == Side::kLeft);
  });
  if (2 * static_cast<std::size_t>(wrong) <= sided.size()) {
    return "";
  }
  return "lie on the other side than their names say (" + std::to_string(wrong) + " of " +
         std::to_string(sided.size()) + " regions): are they mirrored left to right, or of another table of names?";
}

} // namespace

std::vector<std::string> label_doubts(const LabelVolume &labels, const LabelNames &names, const Volume &image) {
  std::vector<std::string> out;
  if (!same_grid(labels, image)) {
    out.emplace_back("lie on another grid than the image: were they made from it?");
  }
  const Census census = count(labels, image);
  if (static_cast<double>(census.outside) > kMostOutside * static_cast<double>(census.voxels)) {
    out.push_back("lie outside of the image in " + std::to_string(100 * census.outside / census.voxels) +
                  " % of their voxels");
  }
  if (std::string doubt = side_doubt(census, names); !doubt.empty()) {
    out.push_back(std::move(doubt));
  }
  return out;
}

} // namespace bregma::casefile
