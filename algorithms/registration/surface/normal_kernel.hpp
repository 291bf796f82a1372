// The sums of a Gauss-Newton step over many rows, in vectors of doubles: J'WJ and J'Wr of six unknowns.
//
// There is one version per vector length; the widest that the processor supports is selected at run time. Pure,
// reentrant, no allocation.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::registration {

// Rows as a structure of arrays. Set the first `count` of them, then pad().
class NormalRows {
public:
  explicit NormalRows(std::size_t capacity);
  void set(std::size_t i, const Eigen::Vector3d &rotation, const Eigen::Vector3d &translation,
           double residual) noexcept {
    for (std::size_t k = 0; k < 3; ++k) {
      jacobian_[k][i] = rotation[static_cast<Eigen::Index>(k)];
      jacobian_[k + 3][i] = translation[static_cast<Eigen::Index>(k)];
    }
    residual_[i] = residual;
  }
  void set_weight(std::size_t i, double weight) noexcept { weight_[i] = weight; }
  // Sets the weight of the rows beyond count, to the end of a vector, to zero.
  void pad(std::size_t count) noexcept;

  [[nodiscard]] geometry::Vector6d jacobian(std::size_t i) const noexcept;
  [[nodiscard]] double weight(std::size_t i) const noexcept { return weight_[i]; }
  [[nodiscard]] double residual(std::size_t i) const noexcept { return residual_[i]; }
  [[nodiscard]] const double *column(std::size_t k) const noexcept { return jacobian_[k].data(); }
  [[nodiscard]] const double *weights() const noexcept { return weight_.data(); }
  [[nodiscard]] const double *residuals() const noexcept { return residual_.data(); }

private:
  std::array<std::vector<double>, 6> jacobian_;
  std::vector<double> weight_, residual_;
};

struct NormalSums {
  std::array<double, 21> normal{}; // the lower triangle by rows
  std::array<double, 6> gradient{};
};

struct NormalKernel {
  std::string_view name;
  // squared: weights are squared first.
  void (*sums)(const NormalRows &rows, std::size_t count, bool squared, NormalSums &out);
};
// Kernels that this processor can run, the widest first; at least one.
[[nodiscard]] std::span<const NormalKernel> normal_kernels() noexcept;

// J'WJ and J'Wr by the widest kernel; with squared weights, J'WWJ.
void add_rows(const NormalRows &rows, std::size_t count, geometry::Matrix6d &normal,
              geometry::Vector6d &gradient) noexcept;
[[nodiscard]] geometry::Matrix6d squared_weight_sum(const NormalRows &rows, std::size_t count) noexcept;

} // namespace bregma::registration
