// The E-step of coherent point drift: the posterior of each source for each target, and its sums over the targets.
//
// P(m|n) = exp(-|x_n - y_m|^2 / 2 sigma^2) / (sum_k exp(-|x_n - y_k|^2 / 2 sigma^2) + c)   [Myronenko 2010, eq. 6]
//
// with c = outlier_constant. No matrix of sources x targets is stored.
//
// Error: while sigma is large all pairs are summed, in floats (gauss_sum_error). Where sigma is small against the
// clouds, a grid limits the sum to pairs within kGaussReach sigmas. Each omitted term is below exp(-kGaussReach^2 / 2)
// = 1.3e-7, where a coincident pair counts one.
//
// Coordinates must be of the order of one (the caller normalises). One thread at a time may use a summer; each call
// starts the requested number of threads and allocates.
#pragma once

#include <algorithm>
#include <vector>

#include "algorithms/geometry/points.hpp"

namespace bregma::registration {

inline constexpr double kGaussReach = 5.634; // sigmas
// Relative error of a sum over all pairs: that of the exponentials, and of coordinates rounded to floats.
[[nodiscard]] inline double gauss_sum_error(double sigma) noexcept { return std::max(1e-5, 1e-6 / sigma); }

template <int D> struct GaussSums {
  Eigen::VectorXd source_weight; // sum_n P(m|n), one per source
  Eigen::VectorXd target_weight; // sum_m P(m|n), one per target
  geometry::Points<D> pull;      // sum_n P(m|n) (x_n - y_m), one per source
  double squares = 0.0;          // sum_mn P(m|n) |x_n - y_m|^2
  double log_divisors = 0.0;     // sum_n log(sum_k exp(...) + c)
};

// c of [Myronenko 2010]: the uniform part has the density 1/N, for clouds that were normalised to variance one.
template <int D>
[[nodiscard]] double paper_outlier_constant(double sigma, double outlier_weight, Eigen::Index sources,
                                            Eigen::Index targets) noexcept;

template <int D> class GaussSummer {
public:
  enum class Method { kChoose, kAllPairs, kGrid };

  GaussSummer(geometry::Points<D> targets, int threads, Method method = Method::kChoose);

  void sum(const geometry::Points<D> &sources, double sigma, double outlier_constant, GaussSums<D> &out);
  [[nodiscard]] bool used_grid() const { return used_grid_; } // in the last call

private:
  using Cell = Eigen::Matrix<int, D, 1>;
  struct Lattice { // cells of one edge length over the targets, with a margin of one cell
    Eigen::Matrix<double, D, 1> low;
    double edge = 0.0;
    Cell size = Cell::Zero();
    [[nodiscard]] int cell_count() const { return size.prod(); }
  };
  struct Sorted {           // points by cell
    std::vector<int> begin; // cell_count + 1
    std::vector<int> order; // indices of points
  };
  struct Work; // work space of one thread

  [[nodiscard]] Lattice lattice(double reach) const;
  static void sort(const Lattice &lattice, const geometry::Points<D> &points, Sorted &out);
  [[nodiscard]] double grid_pairs(const Lattice &lattice) const;
  void sum_tile(const geometry::Points<D> &sources, const std::vector<int> &tile_sources, const int *tile_targets,
                int target_count, double sigma, double outlier_constant, GaussSums<D> &out, Work &work) const;

  geometry::Points<D> targets_;
  Eigen::Matrix<double, D, 1> low_, high_;
  int threads_;
  Method method_;
  bool used_grid_ = false;
  Sorted sorted_targets_, sorted_sources_;
};

extern template class GaussSummer<2>;
extern template class GaussSummer<3>;

} // namespace bregma::registration
