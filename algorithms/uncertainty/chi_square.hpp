// The chi-square distribution of an integer number of degrees of freedom, in closed form.
//
// With Q(a, x) the regularised upper incomplete gamma function, survival = Q(dof/2, x/2), built up from Q(1/2, x) =
// erfc(sqrt x) or Q(1, x) = exp(-x) by Q(a+1, x) = Q(a, x) + x^a exp(-x) / Gamma(a+1); DLMF 8.8.6. All terms are
// positive: no digits are lost. Pure, no allocation.
#pragma once

namespace bregma::uncertainty {

inline constexpr double kChiSquare95Of3 = 7.814727903251178; // 95 % quantile, 3 degrees of freedom

// P(X > x); 1 for x <= 0. dof >= 1.
[[nodiscard]] double chi_square_survival(double x, int dof) noexcept;
[[nodiscard]] double chi_square_cdf(double x, int dof) noexcept;
// The x that is exceeded with the probability tail (0 < tail < 1), to 1e-10 relative.
[[nodiscard]] double chi_square_upper_quantile(double tail, int dof) noexcept;

} // namespace bregma::uncertainty
