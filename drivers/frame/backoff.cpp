#include "drivers/frame/backoff.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::driver {

std::int64_t Backoff::next_ns() {
  const std::int64_t delay_ns = std::min(delay_ns_, options_.max_ns);
  // Never grows beyond the limit, so that doubling cannot overflow.
  delay_ns_ = delay_ns > options_.max_ns / 2 ? options_.max_ns : 2 * delay_ns;
  const double fraction = std::uniform_real_distribution(1.0 - options_.jitter, 1.0)(random_);
  return std::min<std::int64_t>(std::llround(static_cast<double>(delay_ns) * fraction), options_.max_ns);
}

} // namespace bregma::driver
