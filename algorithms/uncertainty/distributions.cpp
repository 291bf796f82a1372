#include "algorithms/uncertainty/distributions.hpp"

#include <cmath>
#include <limits>

#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/normal.hpp>

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
using FisherF = boost::math::fisher_f_distribution<double, Quiet>;
using Normal = boost::math::normal_distribution<double, Quiet>;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

bool is_probability(double p) noexcept { return p > 0.0 && p < 1.0; }

} // namespace

double chi_square_survival(double x, double dof) noexcept {
  if (std::isnan(x) || !(dof > 0.0)) {
    return kNaN;
  }
  if (x <= 0.0 || std::isinf(x)) {
    return x <= 0.0 ? 1.0 : 0.0;
  }
  return cdf(complement(ChiSquare(dof), x));
}

double chi_square_upper_quantile(double tail, double dof) noexcept {
  return is_probability(tail) && dof > 0.0 ? quantile(complement(ChiSquare(dof), tail)) : kNaN;
}

double normal_quantile(double probability) noexcept {
  return is_probability(probability) ? quantile(Normal(), probability) : kNaN;
}

double hotelling_upper_quantile(double tail, double dimensions, double dof) noexcept {
  const double rest = dof - dimensions + 1.0;
  if (!is_probability(tail) || !(dimensions > 0.0) || !(rest > 0.0)) {
    return kNaN;
  }
  return dimensions * dof / rest * quantile(complement(FisherF(dimensions, rest), tail));
}

} // namespace bregma::uncertainty
