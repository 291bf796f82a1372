// How long to wait before the next attempt to connect: doubled after each failure, up to a limit, and shortened at
// random so that many drivers do not come back in the same moment. Threads: one.
#pragma once

#include <cstdint>
#include <random>

namespace bregma::driver {

struct BackoffOptions {
  std::int64_t first_ns = 500'000'000;
  std::int64_t max_ns = 10'000'000'000; // never exceeded
  double jitter = 0.2;                  // at most this fraction of the delay is taken off
};

class Backoff {
public:
  Backoff(const BackoffOptions &options, std::uint64_t seed) : options_(options), random_(seed) { reset(); }

  [[nodiscard]] std::int64_t next_ns();
  // A connection has lasted: the next failure is a first one.
  void reset() { delay_ns_ = options_.first_ns; }

private:
  BackoffOptions options_;
  std::int64_t delay_ns_ = 0;
  std::mt19937_64 random_;
};

} // namespace bregma::driver
