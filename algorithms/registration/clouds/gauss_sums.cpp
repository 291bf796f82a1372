#include "algorithms/registration/clouds/gauss_sums.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <thread>

#include "algorithms/registration/clouds/gauss_kernel.hpp"

namespace bregma::registration {

using geometry::Points;

namespace {

constexpr int kRowsPerTile = 256; // maximum number of targets that are summed in floats
constexpr int kMaxCells = 1 << 20;
// Cost of a pair through the grid in pairs without it: sources are gathered, rows are short.
constexpr double kGridCost = 3.0;

} // namespace

template <int D>
double paper_outlier_constant(double sigma, double outlier_weight, Eigen::Index sources,
                              Eigen::Index targets) noexcept {
  return std::pow(2.0 * std::numbers::pi * sigma * sigma, 0.5 * D) * outlier_weight / (1.0 - outlier_weight) *
         static_cast<double>(sources) / static_cast<double>(targets);
}
template double paper_outlier_constant<2>(double, double, Eigen::Index, Eigen::Index) noexcept;
template double paper_outlier_constant<3>(double, double, Eigen::Index, Eigen::Index) noexcept;

template <int D> struct GaussSummer<D>::Work {
  std::vector<float> floats;
  std::vector<int> sources;
};

template <int D>
GaussSummer<D>::GaussSummer(Points<D> targets, int threads, Method method)
    : targets_(std::move(targets)), low_(targets_.rowwise().minCoeff()), high_(targets_.rowwise().maxCoeff()),
      threads_(std::max(threads, 1)), method_(method) {}

template <int D> typename GaussSummer<D>::Lattice GaussSummer<D>::lattice(double reach) const {
  Lattice out;
  const Eigen::Matrix<double, D, 1> extent = high_ - low_;
  // Never finer than kMaxCells allows.
  out.edge = std::max(reach, std::pow(std::max(extent.prod(), 0.0) / kMaxCells, 1.0 / D));
  const auto size_at = [&](double edge) { return ((extent / edge).array().floor() + 4.0).matrix().eval(); };
  while (size_at(out.edge).prod() > 2.0 * kMaxCells) {
    out.edge *= 1.5;
  }
  out.size = size_at(out.edge).template cast<int>();
  out.low = low_.array() - 1.5 * out.edge; // no target near the margin, despite rounding
  return out;
}

template <int D> void GaussSummer<D>::sort(const Lattice &lattice, const Points<D> &points, Sorted &out) {
  const auto count = static_cast<std::size_t>(points.cols());
  std::vector<int> cells(count, -1);
  out.begin.assign(static_cast<std::size_t>(lattice.cell_count()) + 1, 0);
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Array<double, D, 1> at =
        ((points.col(static_cast<Eigen::Index>(i)) - lattice.low) / lattice.edge).array().floor();
    // Sources beyond the margin are out of reach of all targets.
    if ((at >= 0.0).all() && (at < lattice.size.template cast<double>().array()).all()) {
      int cell = 0;
      for (int d = D - 1; d >= 0; --d) {
        cell = cell * lattice.size[d] + static_cast<int>(at[d]);
      }
      cells[i] = cell;
      ++out.begin[static_cast<std::size_t>(cell) + 1];
    }
  }
  std::partial_sum(out.begin.begin(), out.begin.end(), out.begin.begin());
  out.order.resize(static_cast<std::size_t>(out.begin.back()));
  std::vector<int> next(out.begin.begin(), out.begin.end() - 1);
  for (std::size_t i = 0; i < count; ++i) {
    if (cells[i] >= 0) {
      out.order[static_cast<std::size_t>(next[static_cast<std::size_t>(cells[i])]++)] = static_cast<int>(i);
    }
  }
}

namespace {

// Runs over the rows of cells (along the first axis, three long) around one cell that is not in the margin.
template <int D, class Cell, class Visit> void visit_neighbours(const Cell &size, int cell, Visit &&visit) {
  if constexpr (D == 2) {
    for (int j = -1; j <= 1; ++j) {
      visit(cell + j * size[0] - 1);
    }
  } else {
    for (int k = -1; k <= 1; ++k) {
      for (int j = -1; j <= 1; ++j) {
        visit(cell + (k * size[1] + j) * size[0] - 1);
      }
    }
  }
}

} // namespace

// Number of pairs that the grid would sum.
template <int D> double GaussSummer<D>::grid_pairs(const Lattice &lattice) const {
  double pairs = 0.0;
  for (std::size_t cell = 0; cell + 1 < sorted_targets_.begin.size(); ++cell) {
    const int here = sorted_targets_.begin[cell + 1] - sorted_targets_.begin[cell];
    if (here > 0) {
      int near = 0;
      visit_neighbours<D>(lattice.size, static_cast<int>(cell), [&](int first) {
        const auto at = static_cast<std::size_t>(first);
        near += sorted_sources_.begin[at + 3] - sorted_sources_.begin[at];
      });
      pairs += static_cast<double>(here) * near;
    }
  }
  return pairs;
}

// All pairs of some sources and some targets, in floats about the first target; all sources of these targets must be
// included.
template <int D>
void GaussSummer<D>::sum_tile(const Points<D> &sources, const std::vector<int> &tile_sources, const int *tile_targets,
                              int target_count, double sigma, double outlier_constant, GaussSums<D> &out,
                              Work &work) const {
  const std::size_t count = tile_sources.size();
  const std::size_t size = (count + kGaussLanes - 1) / kGaussLanes * kGaussLanes;
  work.floats.resize((7 + kGaussRows) * size);
  float *const x = work.floats.data();
  float *const sums = x + 3 * size;
  const Eigen::Matrix<double, D, 1> centre = targets_.col(tile_targets[0]);
  for (std::size_t d = 0; d < 3; ++d) {
    std::fill(x + d * size, x + (d + 1) * size, 0.0F);
  }
  for (std::size_t i = 0; i < count; ++i) {
    for (int d = 0; d < D; ++d) {
      x[static_cast<std::size_t>(d) * size + i] = static_cast<float>(sources(d, tile_sources[i]) - centre[d]);
    }
  }
  std::fill(x + count, x + size, kGaussFar);

  const GaussBlock block{size,           x, x + size, x + 2 * size, sums, sums + size, sums + 2 * size, sums + 3 * size,
                         sums + 4 * size};
  const AddGaussRows add_rows = gauss_kernels().front().add_rows;
  const auto inverse = static_cast<float>(0.5 / (sigma * sigma));
  for (int begin = 0; begin < target_count; begin += kRowsPerTile) {
    const int end = std::min(begin + kRowsPerTile, target_count);
    std::fill(sums, sums + 4 * size, 0.0F);
    for (int first = begin; first < end; first += static_cast<int>(kGaussRows)) {
      std::array<GaussRow, kGaussRows> rows{};
      const int used = std::min(static_cast<int>(kGaussRows), end - first);
      for (int r = 0; r < static_cast<int>(kGaussRows); ++r) {
        GaussRow &row = rows[static_cast<std::size_t>(r)];
        const Eigen::Matrix<double, D, 1> p = targets_.col(tile_targets[std::min(first + r, end - 1)]) - centre;
        row.x = static_cast<float>(p[0]);
        row.y = static_cast<float>(p[1]);
        row.z = D == 3 ? static_cast<float>(p[D - 1]) : 0.0F;
        row.used = r < used ? 1.0F : 0.0F;
      }
      add_rows(block, rows.data(), inverse, static_cast<float>(outlier_constant));
      for (int r = 0; r < used; ++r) {
        const GaussRow &row = rows[static_cast<std::size_t>(r)];
        const double divisor = static_cast<double>(row.kernel) + outlier_constant;
        if (divisor > 1e-30) {
          out.target_weight[tile_targets[first + r]] = static_cast<double>(row.kernel) / divisor;
          out.squares += static_cast<double>(row.kernel_squares) / divisor;
        }
        out.log_divisors += std::log(std::max(divisor, 1e-30));
      }
    }
    for (std::size_t i = 0; i < count; ++i) {
      out.source_weight[tile_sources[i]] += static_cast<double>(sums[i]);
      for (int d = 0; d < D; ++d) {
        out.pull(d, tile_sources[i]) += static_cast<double>(sums[static_cast<std::size_t>(d + 1) * size + i]);
      }
    }
  }
}

template <int D>
void GaussSummer<D>::sum(const Points<D> &sources, double sigma, double outlier_constant, GaussSums<D> &out) {
  const auto target_count = static_cast<int>(targets_.cols());
  used_grid_ = false;
  Lattice grid;
  if (method_ != Method::kAllPairs) {
    const double all = static_cast<double>(sources.cols()) * target_count;
    // Counting does not pay off while the reach covers the cloud.
    const double reach = kGaussReach * sigma;
    if (method_ == Method::kGrid || reach < 0.3 * (high_ - low_).norm()) {
      grid = lattice(reach);
      sort(grid, targets_, sorted_targets_);
      sort(grid, sources, sorted_sources_);
      used_grid_ = method_ == Method::kGrid || kGridCost * grid_pairs(grid) < all;
    }
  }

  const auto clear = [&](GaussSums<D> &sums) {
    sums.source_weight.setZero(sources.cols());
    sums.target_weight.setZero(target_count);
    sums.pull.setZero(D, sources.cols());
    sums.squares = 0.0;
    sums.log_divisors = 0.0;
  };
  // Thread `index` of threads_ takes every threads_-th tile or cell.
  const auto run = [&](int index, GaussSums<D> &sums) {
    clear(sums);
    Work work;
    if (!used_grid_) {
      work.sources.resize(static_cast<std::size_t>(sources.cols()));
      std::iota(work.sources.begin(), work.sources.end(), 0);
      std::vector<int> order(static_cast<std::size_t>(target_count));
      std::iota(order.begin(), order.end(), 0);
      for (int begin = index * kRowsPerTile; begin < target_count; begin += threads_ * kRowsPerTile) {
        sum_tile(sources, work.sources, order.data() + begin, std::min(kRowsPerTile, target_count - begin), sigma,
                 outlier_constant, sums, work);
      }
      return;
    }
    for (int cell = index; cell < grid.cell_count(); cell += threads_) {
      const auto at = static_cast<std::size_t>(cell);
      const int here = sorted_targets_.begin[at + 1] - sorted_targets_.begin[at];
      if (here == 0) {
        continue;
      }
      work.sources.clear();
      visit_neighbours<D>(grid.size, cell, [&](int first) {
        const auto from = static_cast<std::size_t>(first);
        work.sources.insert(work.sources.end(), sorted_sources_.order.begin() + sorted_sources_.begin[from],
                            sorted_sources_.order.begin() + sorted_sources_.begin[from + 3]);
      });
      sum_tile(sources, work.sources, sorted_targets_.order.data() + sorted_targets_.begin[at], here, sigma,
               outlier_constant, sums, work);
    }
  };

  std::vector<GaussSums<D>> others(static_cast<std::size_t>(threads_ - 1));
  std::vector<std::jthread> threads;
  for (int i = 1; i < threads_; ++i) {
    threads.emplace_back(run, i, std::ref(others[static_cast<std::size_t>(i - 1)]));
  }
  run(0, out);
  threads.clear(); // joins
  for (const GaussSums<D> &other : others) {
    out.source_weight += other.source_weight;
    out.target_weight += other.target_weight;
    out.pull += other.pull;
    out.squares += other.squares;
    out.log_divisors += other.log_divisors;
  }
}

template class GaussSummer<2>;
template class GaussSummer<3>;

} // namespace bregma::registration
