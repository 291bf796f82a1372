// Delay before the next attempt to connect: doubled after each failure, up to a limit, and shortened at random so that
// many drivers do not reconnect at the same time. Threads: one.
#pragma once

#include <cstdint>
#include <random>

namespace bregma::driver {

struct BackoffOptions {
  std::int64_t first_ns = 500'000'000;
  std::int64_t max_ns = 10'000'000'000; // never exceeded
  double jitter = 0.2;                  // the delay is shortened by at most this fraction
};

class Backoff {
public:
  Backoff(const BackoffOptions &options, std::uint64_t seed) : options_(options), random_(seed) { reset(); }

  [[nodiscard]] std::int64_t next_ns();
  // To be called after a lasting connection: the next failure counts as the first one.
  void reset() { delay_ns_ = options_.first_ns; }

private:
  BackoffOptions options_;
  std::int64_t delay_ns_ = 0;
  std::mt19937_64 random_;
};

} // namespace bregma::driver
