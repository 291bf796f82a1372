// Region mutual information and second-order mutual information: measures of voxels with their neighbours.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "algorithms/intensity/pair_sampler.hpp"
#include "algorithms/intensity/variants.hpp"

namespace bregma::intensity {

namespace {

constexpr float kAbsent = std::numeric_limits<float>::quiet_NaN();

// The floating image on the reference's grid, and the voxels of the reference by row.
class Lattice {
public:
  Lattice(const Volume &reference, const Volume &floating, std::vector<float> floating_values, float outside,
          const MeasureOptions &options, parallel::Team &team)
      : grid(reference), sampler(reference, floating), mapped(sampler.padded()), floating_(std::move(floating_values)),
        nearest_(options.interpolation == Interpolation::kNearest), outside_(outside),
        min_overlap_(options.min_overlap), team_(team) {}

  void map(const Eigen::Matrix4d &T_floating_reference) noexcept {
    sampler.set_pose(T_floating_reference);
    team_.run_parts(sampler.parts().size(), [&](std::size_t p) {
      sampler.sample(sampler.parts()[p], floating_, nearest_, outside_, {mapped.data()});
    });
  }
  // job(first row, last row, block): rows are lines of voxels along the first axis, in kBlocks blocks.
  static constexpr int kBlocks = 4;
  template <class Job> void for_blocks(const Job &job) const noexcept {
    const int rows = grid.size[1] * grid.size[2];
    team_.run_parts(kBlocks, [&](std::size_t block) {
      const int at = static_cast<int>(block);
      job(rows * at / kBlocks, rows * (at + 1) / kBlocks, block);
    });
  }
  [[nodiscard]] double overlap(double compared, double possible) const {
    return possible > 0.0 ? compared / (possible * sampler.reachable()) : 0.0;
  }
  [[nodiscard]] bool enough(double overlap) const { return overlap > 0.0 && overlap >= min_overlap_; }

  image::Grid<3> grid;
  PairSampler sampler;
  std::vector<float> mapped;

private:
  std::vector<float> floating_;
  bool nearest_;
  float outside_;
  double min_overlap_;
  parallel::Team &team_;
};

// Logarithm of the determinant of a positive definite matrix, which is replaced by its Cholesky factor.
double log_determinant(Eigen::Ref<Eigen::MatrixXd> m) noexcept {
  double sum = 0.0;
  for (Eigen::Index j = 0; j < m.rows(); ++j) {
    double pivot = m(j, j);
    for (Eigen::Index k = 0; k < j; ++k) {
      pivot -= m(j, k) * m(j, k);
    }
    if (!(pivot > 0.0)) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    const double root = std::sqrt(pivot);
    sum += 2.0 * std::log(root);
    m(j, j) = root;
    for (Eigen::Index i = j + 1; i < m.rows(); ++i) {
      double value = m(i, j);
      for (Eigen::Index k = 0; k < j; ++k) {
        value -= m(i, k) * m(j, k);
      }
      m(i, j) = value / root;
    }
  }
  return sum;
}

class RegionMi final : public SimilarityMeasure {
public:
  RegionMi(const Volume &reference, const Volume &floating, const MeasureOptions &options, parallel::Team &team)
      : lattice_(reference, floating, scaled(floating.voxels), options.outside == Outside::kDark ? 0.0F : kAbsent,
                 options, team),
        reference_(scaled(reference.voxels)) {
    const auto &size = reference.size;
    for (int k = size[2] > 1 ? -1 : 0; k <= (size[2] > 1 ? 1 : 0); ++k) {
      for (int j = -1; j <= 1; ++j) {
        for (int i = -1; i <= 1; ++i) {
          offsets_.push_back((static_cast<std::ptrdiff_t>(k) * size[1] + j) * size[0] + i);
        }
      }
    }
    const auto d = static_cast<Eigen::Index>(2 * offsets_.size());
    covariance_ = work_ = Eigen::MatrixXd(d, d);
    for (Block &block : blocks_) {
      block.points = Eigen::MatrixXf(kPoints, d);
      block.second = Eigen::MatrixXd(d, d);
      block.first = Eigen::VectorXd(d);
    }
    for_regions([&](std::size_t at) { possible_ += complete(reference_, at) ? 1.0 : 0.0; });
  }

  double value(const Eigen::Matrix4d &T_floating_reference) noexcept override {
    lattice_.map(T_floating_reference);
    lattice_.for_blocks([&](int first, int last, std::size_t b) { accumulate(blocks_[b], first, last); });
    Block &sum = blocks_[0];
    for (std::size_t b = 1; b < blocks_.size(); ++b) {
      sum.count += blocks_[b].count;
      sum.first += blocks_[b].first;
      sum.second += blocks_[b].second;
    }
    overlap_ = lattice_.overlap(sum.count, possible_);
    if (!lattice_.enough(overlap_)) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    const Eigen::Index d = covariance_.rows();
    const Eigen::Index half = d / 2;
    for (Eigen::Index j = 0; j < d; ++j) {
      for (Eigen::Index i = j; i < d; ++i) {
        covariance_(i, j) = sum.second(i, j) / sum.count - sum.first[i] * sum.first[j] / (sum.count * sum.count);
      }
      covariance_(j, j) += kFloor; // areas of one grey value have no variance
    }
    // Entropies of Gaussians: the constants of the marginal and joint ones cancel.
    work_ = covariance_;
    const double joint = log_determinant(work_);
    work_.topLeftCorner(half, half) = covariance_.topLeftCorner(half, half);
    const double of_reference = log_determinant(work_.topLeftCorner(half, half));
    work_.topLeftCorner(half, half) = covariance_.bottomRightCorner(half, half);
    const double of_floating = log_determinant(work_.topLeftCorner(half, half));
    return 0.5 * (of_reference + of_floating - joint);
  }
  [[nodiscard]] std::size_t samples() const noexcept override { return lattice_.sampler.size(); }

private:
  static constexpr Eigen::Index kPoints = 256;
  static constexpr double kFloor = 1e-6; // of the squared range of grey values
  struct Block {
    double count = 0.0;
    Eigen::MatrixXf points; // one per row
    Eigen::MatrixXd second;
    Eigen::VectorXd first;
  };

  static std::vector<float> scaled(std::vector<float> values) {
    const GreyRange range = grey_range(values);
    for (float &v : values) {
      v = range.constant() ? 0.0F * v : (v - range.low) / (range.high - range.low);
    }
    return values;
  }

  // Calls job(offset) for voxels whose neighbours all exist, of some rows.
  template <class Job> void for_regions(const Job &job, int first = 0, int last = -1) const {
    const auto &size = lattice_.grid.size;
    const int end = last < 0 ? size[1] * size[2] : last;
    for (int row = first; row < end; ++row) {
      const int j = row % size[1];
      const int k = row / size[1];
      if (j == 0 || j == size[1] - 1 || (size[2] > 1 && (k == 0 || k == size[2] - 1))) {
        continue;
      }
      for (int i = 1; i < size[0] - 1; ++i) {
        job(lattice_.grid.offset(i, j, k));
      }
    }
  }
  [[nodiscard]] bool complete(const std::vector<float> &values, std::size_t at) const noexcept {
    return std::all_of(offsets_.begin(), offsets_.end(), [&](std::ptrdiff_t o) {
      return std::isfinite(values[static_cast<std::size_t>(static_cast<std::ptrdiff_t>(at) + o)]);
    });
  }

  void accumulate(Block &block, int first, int last) noexcept {
    block.count = 0.0;
    block.first.setZero();
    block.second.setZero();
    Eigen::Index filled = 0;
    for_regions(
        [&](std::size_t at) {
          if (!complete(reference_, at) || !complete(lattice_.mapped, at)) {
            return;
          }
          const auto n = static_cast<Eigen::Index>(offsets_.size());
          for (Eigen::Index c = 0; c < n; ++c) {
            const auto from =
                static_cast<std::size_t>(static_cast<std::ptrdiff_t>(at) + offsets_[static_cast<std::size_t>(c)]);
            block.points(filled, c) = reference_[from];
            block.points(filled, n + c) = lattice_.mapped[from];
          }
          if (++filled == kPoints) {
            flush(block, filled);
            filled = 0;
          }
        },
        first, last);
    flush(block, filled);
  }

  static void flush(Block &block, Eigen::Index filled) noexcept {
    block.count += static_cast<double>(filled);
    for (Eigen::Index j = 0; j < block.second.cols(); ++j) {
      const auto column = block.points.col(j).head(filled);
      block.first[j] += static_cast<double>(column.sum());
      for (Eigen::Index i = j; i < block.second.rows(); ++i) {
        block.second(i, j) += static_cast<double>(block.points.col(i).head(filled).dot(column));
      }
    }
  }

  Lattice lattice_;
  std::vector<float> reference_;
  std::vector<std::ptrdiff_t> offsets_;
  double possible_ = 0.0;
  std::array<Block, Lattice::kBlocks> blocks_;
  Eigen::MatrixXd covariance_, work_;
};

std::vector<float> to_bins(std::vector<float> values, const MeasureOptions &options) {
  const GreyRange range = grey_range(values, options.tail);
  const BinScale scale = bin_scale(range.low, range.high, options.bins, false);
  for (float &v : values) {
    v = std::isfinite(v) ? std::clamp(scale(v), 0.0F, static_cast<float>(options.bins - 1)) : kAbsent;
  }
  return values;
}

class SecondOrderMi final : public SimilarityMeasure {
public:
  SecondOrderMi(const Volume &reference, const Volume &floating, const MeasureOptions &options, parallel::Team &team)
      : bins_(options.bins), lattice_(reference, floating, to_bins(floating.voxels, options),
                                      options.outside == Outside::kDark ? 0.0F : kAbsent, options, team),
        reference_(to_bins(reference.voxels, options)) {
    const int pairs = bins_ * bins_;
    blocks_.assign(Lattice::kBlocks, JointHistogram(pairs, pairs)); // row: pair of the reference, column: of the other
    add_pairs(0, lattice_.grid.size[1] * lattice_.grid.size[2], reference_, blocks_[0]);
    possible_ = blocks_[0].summarise().samples;
  }

  double value(const Eigen::Matrix4d &T_floating_reference) noexcept override {
    lattice_.map(T_floating_reference);
    lattice_.for_blocks(
        [&](int first, int last, std::size_t b) { add_pairs(first, last, lattice_.mapped, blocks_[b]); });
    for (std::size_t b = 1; b < blocks_.size(); ++b) {
      blocks_[0].add(blocks_[b]);
    }
    const Entropies &h = blocks_[0].summarise();
    overlap_ = lattice_.overlap(h.samples, possible_);
    return lattice_.enough(overlap_) ? h.mutual_information() : std::numeric_limits<double>::quiet_NaN();
  }
  [[nodiscard]] std::size_t samples() const noexcept override { return lattice_.sampler.size(); }

private:
  void add_pairs(int first, int last, const std::vector<float> &other, JointHistogram &into) noexcept {
    into.clear();
    const auto &size = lattice_.grid.size;
    const std::array<std::size_t, 3> stride{1, static_cast<std::size_t>(size[0]),
                                            static_cast<std::size_t>(size[0]) * static_cast<std::size_t>(size[1])};
    for (int row = first; row < last; ++row) {
      const std::array<int, 2> at{row % size[1], row / size[1]};
      for (int i = 0; i < size[0]; ++i) {
        const std::size_t here = lattice_.grid.offset(i, at[0], at[1]);
        for (std::size_t d = 0; d < 3; ++d) {
          const bool last_of_axis = (d == 0 ? i : at[d - 1]) == size[d] - 1;
          if (!last_of_axis) {
            add_pair(here, here + stride[d], other, into);
          }
        }
      }
    }
  }
  void add_pair(std::size_t a, std::size_t b, const std::vector<float> &other, JointHistogram &into) const noexcept {
    const std::array<float, 4> v{reference_[a], reference_[b], other[a], other[b]};
    if (!std::all_of(v.begin(), v.end(), [](float x) { return std::isfinite(x); })) {
      return;
    }
    const auto n = static_cast<std::size_t>(bins_);
    std::array<std::size_t, 4> bin{};
    std::transform(v.begin(), v.end(), bin.begin(), [](float x) { return bin_at(x); });
    const std::span<float> counts = into.counts();
    counts[(bin[0] * n + bin[1]) * n * n + bin[2] * n + bin[3]] += 1.0F;
    counts[(bin[1] * n + bin[0]) * n * n + bin[3] * n + bin[2]] += 1.0F;
  }

  int bins_;
  Lattice lattice_;
  std::vector<float> reference_;
  std::vector<JointHistogram> blocks_;
  double possible_ = 0.0;
};

} // namespace

MeasurePointer make_rmi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                        parallel::Team &team) {
  return std::make_unique<RegionMi>(reference, floating, options, team);
}
MeasurePointer make_second_order_mi(const Volume &reference, const Volume &floating, const MeasureOptions &options,
                                    parallel::Team &team) {
  return std::make_unique<SecondOrderMi>(reference, floating, options, team);
}

} // namespace bregma::intensity
