#include "algorithms/uncertainty/chi_square.hpp"

#include <cmath>

namespace bregma::uncertainty {

double chi_square_survival(double x, int dof) noexcept {
  if (!(x > 0.0)) {
    return std::isnan(x) ? x : 1.0;
  }
  if (std::isinf(x)) {
    return 0.0;
  }
  const double half = 0.5 * x;
  const bool odd = dof % 2 != 0;
  double a = odd ? 0.5 : 1.0;
  double q = odd ? std::erfc(std::sqrt(half)) : std::exp(-half);
  // The term x^a exp(-x) / Gamma(a+1), kept as a logarithm so that many degrees of freedom do not overflow. Gamma(3/2)
  // is sqrt(pi)/2, Gamma(2) is 1.
  constexpr double kLogGammaOf3Halves = -0.12078223763524522;
  double log_term = a * std::log(half) - half - (odd ? kLogGammaOf3Halves : 0.0);
  for (; 2.0 * a < dof; a += 1.0) {
    q += std::exp(log_term);
    log_term += std::log(half / (a + 1.0));
  }
  return q < 1.0 ? q : 1.0;
}

double chi_square_cdf(double x, int dof) noexcept { return 1.0 - chi_square_survival(x, dof); }

double chi_square_upper_quantile(double tail, int dof) noexcept {
  double low = 0.0;
  double high = dof + 10.0;
  while (chi_square_survival(high, dof) > tail) {
    low = high;
    high *= 2.0;
  }
  while (high - low > 1e-11 * high) {
    const double middle = 0.5 * (low + high);
    (chi_square_survival(middle, dof) > tail ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

} // namespace bregma::uncertainty
