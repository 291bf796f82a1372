#include "algorithms/intensity/ordinal_feature.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numeric>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "algorithms/intensity/histogram_measure.hpp"
#include "algorithms/intensity/resolution.hpp"
#include "algorithms/intensity/variants.hpp"

namespace bregma::intensity {

namespace {

constexpr std::size_t kLandmarks = 400;
constexpr int kNeighbours = 12;
constexpr int kReach = 2; // voxels from the centre to the lobes of a filter
constexpr double kRegularisation = 1e-3;

using Direction = std::array<int, 3>;
constexpr std::array<Direction, 4> kInPlane{{{1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {1, -1, 0}}};
constexpr std::array<Direction, 7> kInSpace{
    {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}, {1, 1, -1}, {1, -1, 1}, {-1, 1, 1}}};

// One row per voxel, one column per direction.
Eigen::MatrixXf filter_responses(const Volume &image, parallel::Team &team) {
  const std::vector<Direction> directions = image.size[2] == 1
                                                ? std::vector<Direction>(kInPlane.begin(), kInPlane.end())
                                                : std::vector<Direction>(kInSpace.begin(), kInSpace.end());
  const Volume lobes = smoothed(image, image.spacing_mm().head<2>().mean(), team);
  Eigen::MatrixXf out(static_cast<Eigen::Index>(directions.size()), static_cast<Eigen::Index>(image.voxels.size()));
  const auto at = [&](int i, int j, int k, const Direction &d, int sign) {
    return lobes.at(std::clamp(i + sign * kReach * d[0], 0, image.size[0] - 1),
                    std::clamp(j + sign * kReach * d[1], 0, image.size[1] - 1),
                    std::clamp(k + sign * kReach * d[2], 0, image.size[2] - 1));
  };
  const int rows = image.size[1] * image.size[2];
  team.run([&](int thread) {
    for (int row = thread; row < rows; row += team.size()) {
      const int j = row % image.size[1];
      const int k = row / image.size[1];
      for (int i = 0; i < image.size[0]; ++i) {
        for (std::size_t d = 0; d < directions.size(); ++d) {
          const float plus = at(i, j, k, directions[d], 1);
          const float minus = at(i, j, k, directions[d], -1);
          const float total = std::abs(plus) + std::abs(minus);
          const float response = total > 0.0F ? (plus - minus) / total : 0.0F; // the order, not the contrast
          out(static_cast<Eigen::Index>(d), static_cast<Eigen::Index>(image.offset(i, j, k))) =
              std::isfinite(response) ? response : 0.0F;
        }
      }
    }
  });
  return out;
}

struct Neighbourhood {
  std::array<int, kNeighbours> index{};
  Eigen::Matrix<double, kNeighbours, 1> weight;
};

// The point as an affine combination of its neighbours among the landmarks; `self` is not one of them.
Neighbourhood neighbourhood(const Eigen::VectorXf &point, const Eigen::MatrixXf &landmarks, int self) {
  std::array<std::pair<float, int>, kNeighbours> nearest;
  nearest.fill({std::numeric_limits<float>::infinity(), 0});
  for (int l = 0; l < static_cast<int>(landmarks.cols()); ++l) {
    const float d2 = (landmarks.col(l) - point).squaredNorm();
    if (l == self || !(d2 < nearest.back().first)) {
      continue;
    }
    auto at = nearest.end() - 1;
    while (at != nearest.begin() && (at - 1)->first > d2) {
      *at = *(at - 1);
      --at;
    }
    *at = {d2, l};
  }
  Neighbourhood out;
  Eigen::Matrix<double, Eigen::Dynamic, kNeighbours> difference(point.size(), kNeighbours);
  for (int n = 0; n < kNeighbours; ++n) {
    out.index[static_cast<std::size_t>(n)] = nearest[static_cast<std::size_t>(n)].second;
    difference.col(n) = (landmarks.col(nearest[static_cast<std::size_t>(n)].second) - point).cast<double>();
  }
  Eigen::Matrix<double, kNeighbours, kNeighbours> gram = difference.transpose() * difference;
  gram.diagonal().array() += kRegularisation * gram.trace() + 1e-9;
  out.weight = gram.ldlt().solve(Eigen::Matrix<double, kNeighbours, 1>::Ones());
  out.weight /= out.weight.sum();
  return out;
}

// Voxels with an order in some direction, evenly spread over memory.
std::vector<Eigen::Index> choose_landmarks(const Eigen::MatrixXf &responses) {
  std::vector<Eigen::Index> marked;
  for (Eigen::Index i = 0; i < responses.cols(); ++i) {
    if (responses.col(i).squaredNorm() > 1e-6F) {
      marked.push_back(i);
    }
  }
  std::vector<Eigen::Index> out;
  const std::size_t count = std::min(kLandmarks, marked.size());
  for (std::size_t n = 0; n < count; ++n) {
    out.push_back(marked[(2 * n + 1) * marked.size() / (2 * count)]);
  }
  return out;
}

// Embedding in one dimension: the eigenvector of the second smallest eigenvalue of (I - W)^T (I - W).
Eigen::VectorXd embed(const Eigen::MatrixXf &landmarks) {
  const Eigen::Index n = landmarks.cols();
  Eigen::MatrixXd rest = Eigen::MatrixXd::Identity(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Neighbourhood around = neighbourhood(landmarks.col(i), landmarks, static_cast<int>(i));
    for (int k = 0; k < kNeighbours; ++k) {
      rest(i, around.index[static_cast<std::size_t>(k)]) -= around.weight[k];
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(rest.transpose() * rest);
  return solver.eigenvectors().col(1);
}

// Ranks to levels.
std::vector<float> to_levels(const std::vector<float> &values) {
  std::vector<float> sorted = values;
  std::sort(sorted.begin(), sorted.end());
  std::array<float, kOrdinalLevels - 1> limit{};
  for (std::size_t level = 1; level < kOrdinalLevels; ++level) {
    limit[level - 1] = sorted[level * sorted.size() / kOrdinalLevels];
  }
  std::vector<float> out(values.size());
  std::transform(values.begin(), values.end(), out.begin(), [&](float v) {
    return static_cast<float>(std::upper_bound(limit.begin(), limit.end(), v) - limit.begin());
  });
  return out;
}

} // namespace

std::vector<float> ordinal_feature(const Volume &image, parallel::Team &team) {
  const Eigen::MatrixXf responses = filter_responses(image, team);
  const std::vector<Eigen::Index> chosen = choose_landmarks(responses);
  if (chosen.size() <= kNeighbours) { // a uniform image has no order
    return std::vector<float>(image.voxels.size(), 0.0F);
  }
  Eigen::MatrixXf landmarks(responses.rows(), static_cast<Eigen::Index>(chosen.size()));
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    landmarks.col(static_cast<Eigen::Index>(i)) = responses.col(chosen[i]);
  }
  const Eigen::VectorXd embedded = embed(landmarks);
  std::vector<float> fused(image.voxels.size());
  team.run([&](int thread) {
    for (auto i = static_cast<std::size_t>(thread); i < fused.size(); i += static_cast<std::size_t>(team.size())) {
      const Neighbourhood around = neighbourhood(responses.col(static_cast<Eigen::Index>(i)), landmarks, -1);
      double sum = 0.0;
      for (int k = 0; k < kNeighbours; ++k) {
        sum += around.weight[k] * embedded[around.index[static_cast<std::size_t>(k)]];
      }
      fused[i] = static_cast<float>(sum);
    }
  });
  return to_levels(fused);
}

MeasurePointer make_lle_he(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                           parallel::Team &team) {
  // (R, X) as one label: HE = H(F) + H(R, X) - H(R, F, X) is its mutual information with F.
  constexpr int kMaxGreys = 32;
  const int greys = std::min(options.bins, kMaxGreys);
  const GreyRange range = grey_range(reference.voxels, options.tail);
  const BinScale scale = bin_scale(range.low, range.high, greys, false);
  std::vector<float> label = ordinal_feature(reference, team);
  for (std::size_t i = 0; i < label.size(); ++i) {
    const float grey = std::round(std::clamp(scale(reference.voxels[i]), 0.0F, static_cast<float>(greys - 1)));
    label[i] = std::isfinite(reference.voxels[i]) ? label[i] * static_cast<float>(greys) + grey
                                                  : std::numeric_limits<float>::quiet_NaN();
  }
  // Moved samples would mix labels of neighbouring voxels, so that all voxels are compared.
  MeasureOptions of_all = options;
  of_all.max_samples = 0;
  std::vector<HistogramMeasure::Channel> channels;
  channels.push_back({std::move(label), floating.voxels, 1.0, greys * kOrdinalLevels});
  return std::make_unique<HistogramMeasure>(reference, floating, std::move(channels), false, of_all, team);
}

} // namespace bregma::intensity
