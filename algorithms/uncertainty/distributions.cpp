#include "algorithms/uncertainty/distributions.hpp"

#include <cmath>

#include <boost/math/distributions/beta.hpp>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/normal.hpp>

#include "algorithms/geometry/unknown.hpp"

namespace bregma::uncertainty {
namespace {

namespace policies = boost::math::policies;

// Ignored errors return NaN or infinity; without promotion, double is computed in double.
using Quiet =
    policies::policy<policies::domain_error<policies::ignore_error>, policies::pole_error<policies::ignore_error>,
                     policies::overflow_error<policies::ignore_error>,
                     policies::underflow_error<policies::ignore_error>, policies::denorm_error<policies::ignore_error>,
                     policies::evaluation_error<policies::ignore_error>,
                     policies::rounding_error<policies::ignore_error>,
                     policies::indeterminate_result_error<policies::ignore_error>, policies::promote_double<false>>;
using ChiSquare = boost::math::chi_squared_distribution<double, Quiet>;
using Beta = boost::math::beta_distribution<double, Quiet>;
using Normal = boost::math::normal_distribution<double, Quiet>;

bool is_probability(double p) noexcept { return p > 0.0 && p < 1.0; }

} // namespace

double chi_square_survival(double x, double dof) noexcept {
  if (std::isnan(x) || !(dof > 0.0)) {
    return geometry::kUnknown;
  }
  if (x <= 0.0 || std::isinf(x)) {
    return x <= 0.0 ? 1.0 : 0.0;
  }
  return cdf(complement(ChiSquare(dof), x));
}

double chi_square_upper_quantile(double tail, double dof) noexcept {
  return is_probability(tail) && dof > 0.0 ? quantile(complement(ChiSquare(dof), tail)) : geometry::kUnknown;
}

double f_survival(double x, double dof_above, double dof_below) noexcept {
  if (std::isnan(x) || !(dof_above > 0.0) || !(dof_below > 0.0)) {
    return geometry::kUnknown;
  }
  // dof_below / (dof_below + dof_above X) is beta distributed.
  return x <= 0.0 ? 1.0 : cdf(Beta(0.5 * dof_below, 0.5 * dof_above), dof_below / (dof_below + dof_above * x));
}

double normal_quantile(double probability) noexcept {
  return is_probability(probability) ? quantile(Normal(), probability) : geometry::kUnknown;
}

double hotelling_upper_quantile(double tail, double dimensions, double dof) noexcept {
  const double rest = dof - dimensions + 1.0;
  if (!is_probability(tail) || !(dimensions > 0.0) || !(rest > 0.0)) {
    return geometry::kUnknown;
  }
  // T-square / (dof + T-square) is beta distributed.
  const double x = quantile(complement(Beta(0.5 * dimensions, 0.5 * rest), tail));
  return dof * x / (1.0 - x);
}

} // namespace bregma::uncertainty
