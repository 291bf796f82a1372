#include "algorithms/intensity/pair_sampler.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/LU>

namespace bregma::intensity {

namespace {

constexpr std::size_t kSamplesPerPart = 2048;
constexpr std::size_t kMaxParts = 8; // each has a histogram of its own, to be cleared and added
constexpr float kFarAway = 1e9F;     // index of padding: outside of every image

// From 0 to 1, the same with every standard library.
double uniform(std::mt19937_64 &rng) { return static_cast<double>(rng() >> 11U) * 0x1.0p-53; }

double known_mm3(const Volume &image) {
  const auto known = std::count_if(image.voxels.begin(), image.voxels.end(), [](float v) { return std::isfinite(v); });
  return static_cast<double>(known) * std::abs(image.axes().determinant());
}

} // namespace

PairSampler::PairSampler(const Volume &reference, const Volume &floating, std::size_t max_samples, std::uint64_t seed)
    : reference_(reference), floating_(floating), kernels_(sample_kernels()) {
  std::vector<std::size_t> known; // offsets of the voxels with a value; empty: all have one
  const bool all =
      std::none_of(reference.voxels.begin(), reference.voxels.end(), [](float v) { return !std::isfinite(v); });
  if (!all) {
    for (std::size_t i = 0; i < reference.voxels.size(); ++i) {
      if (std::isfinite(reference.voxels[i])) {
        known.push_back(i);
      }
    }
  }
  const std::size_t valid = all ? reference.voxels.size() : known.size();
  const bool choose = max_samples > 0 && valid > max_samples;
  const std::size_t wanted = choose ? max_samples : valid;
  std::mt19937_64 rng(seed);
  const auto moved = [&](std::size_t at, int size) {
    const double shift = choose && size > 1 ? uniform(rng) - 0.5 : 0.0;
    return static_cast<float>(std::clamp(static_cast<double>(at) + shift, 0.0, static_cast<double>(size - 1)));
  };
  for (auto *list : {&x_, &y_, &z_}) {
    list->reserve(wanted + kSamplePadding);
  }
  const auto nx = static_cast<std::size_t>(reference.size[0]);
  const auto ny = static_cast<std::size_t>(reference.size[1]);
  const double stratum = static_cast<double>(valid) / static_cast<double>(std::max(wanted, std::size_t{1}));
  for (std::size_t s = 0; s < wanted; ++s) {
    // One of each stretch of voxels in memory's order: even in space.
    const double place = choose ? (static_cast<double>(s) + uniform(rng)) * stratum : static_cast<double>(s);
    const std::size_t rank = std::min(static_cast<std::size_t>(place), valid - 1);
    const std::size_t at = all ? rank : known[rank];
    x_.push_back(moved(at % nx, reference.size[0]));
    y_.push_back(moved(at / nx % ny, reference.size[1]));
    z_.push_back(moved(at / (nx * ny), reference.size[2]));
  }
  finish();
  if (choose && valid < reference.voxels.size()) { // a moved sample may need a voxel without a value
    const std::vector<float> values = of_reference(reference.voxels);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      if (std::isfinite(values[i])) {
        x_[kept] = x_[i];
        y_[kept] = y_[i];
        z_[kept++] = z_[i];
      }
    }
    for (auto *list : {&x_, &y_, &z_}) {
      list->resize(kept);
    }
    finish();
  }
  const double of_samples = static_cast<double>(valid) * std::abs(reference.axes().determinant());
  const double of_floating = known_mm3(floating);
  reachable_ = of_samples > 0.0 ? std::min(1.0, of_floating / of_samples) : 1.0;
}

PairSampler::PairSampler(const Volume &reference, const Volume &floating)
    : reference_(reference), floating_(floating), kernels_(sample_kernels()) {
  for (int k = 0; k < reference.size[2]; ++k) {
    for (int j = 0; j < reference.size[1]; ++j) {
      for (int i = 0; i < reference.size[0]; ++i) {
        x_.push_back(static_cast<float>(i));
        y_.push_back(static_cast<float>(j));
        z_.push_back(static_cast<float>(k));
      }
    }
  }
  finish();
  const double of_floating = known_mm3(floating);
  reachable_ = std::min(1.0, of_floating / (static_cast<double>(count_) * std::abs(reference.axes().determinant())));
}

void PairSampler::finish() {
  count_ = x_.size();
  const std::size_t padded = (count_ + kSamplePadding - 1) / kSamplePadding * kSamplePadding;
  for (auto *list : {&x_, &y_, &z_}) {
    list->resize(padded, kFarAway);
  }
  const std::size_t number = std::clamp(count_ / kSamplesPerPart, std::size_t{1}, kMaxParts);
  const std::size_t blocks = padded / kSamplePadding;
  parts_.clear();
  for (std::size_t p = 0; p < number; ++p) {
    const std::size_t first = blocks * p / number * kSamplePadding;
    const std::size_t end = blocks * (p + 1) / number * kSamplePadding;
    parts_.push_back({first, end - first, std::min(end, count_) - first});
  }
  index_from_floating_ = floating_.T_image_index.inverse();
  set_pose(Eigen::Matrix4d::Identity());
}

std::vector<float> PairSampler::of_reference(const std::vector<float> &values) const {
  std::vector<float> out(padded());
  const SampledGrid grid{values.data(), reference_.size};
  constexpr std::array<float, 12> kIdentity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  const SampleBlock block{x_.data(), y_.data(), z_.data(), padded()};
  const bool on_grid = std::all_of(x_.begin(), x_.begin() + static_cast<std::ptrdiff_t>(count_),
                                   [](float x) { return x == std::floor(x); });
  // On the grid no neighbour may matter, since it may have no value.
  (on_grid ? kernels_.nearest : kernels_.linear)(block, kIdentity, grid, std::numeric_limits<float>::quiet_NaN(),
                                                 {out.data()});
  return out;
}

void PairSampler::set_pose(const Eigen::Matrix4d &T_floating_reference) noexcept {
  const Eigen::Matrix4d map = index_from_floating_ * T_floating_reference * reference_.T_image_index;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      T_[4 * static_cast<std::size_t>(row) + static_cast<std::size_t>(column)] = static_cast<float>(map(row, column));
    }
  }
  linear_ = T_floating_reference.topLeftCorner<3, 3>().cast<float>();
}

std::array<std::vector<float>, 3> &PairSampler::moved() {
  if (moved_[0].empty()) {
    moved_ = {x_, y_, z_};
  }
  return moved_;
}

void PairSampler::sample(const Part &part, const std::vector<float> &values, bool nearest, float outside,
                         const SampledValues &out) const noexcept {
  const bool deformed = !moved_[0].empty();
  const SampleBlock block{(deformed ? moved_[0] : x_).data() + part.first,
                          (deformed ? moved_[1] : y_).data() + part.first,
                          (deformed ? moved_[2] : z_).data() + part.first, part.count};
  SampledValues from = out;
  for (float **list : {&from.value, &from.dx, &from.dy, &from.dz}) {
    *list = *list != nullptr ? *list + part.first : nullptr;
  }
  (nearest ? kernels_.nearest : kernels_.linear)(block, T_, {values.data(), floating_.size}, outside, from);
}

bool PairSampler::neighbours(std::size_t sample, Neighbours &out) const noexcept {
  const std::array<float, 3> p{x_[sample], y_[sample], z_[sample]};
  std::size_t stride = 1;
  out.offset.fill(0);
  out.weight.fill(1.0F);
  for (std::size_t d = 0; d < 3; ++d) {
    const float at = T_[4 * d] * p[0] + T_[4 * d + 1] * p[1] + T_[4 * d + 2] * p[2] + T_[4 * d + 3];
    const int n = floating_.size[d];
    const float slack = n > 1 ? 1e-3F : 0.5F;
    if (!(at >= -slack && at <= static_cast<float>(n - 1) + slack)) {
      return false;
    }
    const float inside = std::clamp(at, 0.0F, static_cast<float>(n - 1));
    const int base = std::min(static_cast<int>(inside), std::max(n - 2, 0));
    const float fraction = inside - static_cast<float>(base);
    for (std::size_t corner = 0; corner < 8; ++corner) {
      const bool upper = ((corner >> d) & 1U) != 0;
      out.offset[corner] += stride * static_cast<std::size_t>(base + (upper && n > 1 ? 1 : 0));
      out.weight[corner] *= upper ? fraction : 1.0F - fraction;
    }
    stride *= static_cast<std::size_t>(n);
  }
  return true;
}

Affine34 PairSampler::to_mm(const Affine34 &by_index) const noexcept {
  return index_from_floating_.topLeftCorner<3, 3>().transpose() * by_index * reference_.T_image_index.transpose();
}

} // namespace bregma::intensity
