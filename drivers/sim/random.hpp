// Random numbers in named streams. The numbers of one source do not depend on the draws of others, so an added fault or
// device does not change the rest of a seed's run.
#pragma once

#include <cstdint>
#include <random>
#include <string_view>

#include <Eigen/Core>

namespace bregma::sim {

class Random {
public:
  Random(std::uint64_t seed, std::string_view stream) : engine_(mix(seed, stream)) {}

  double uniform(double low, double high) { return low + (high - low) * unit_(engine_); }
  double normal(double sigma) { return sigma * normal_(engine_); }
  double exponential(double mean) { return mean * exponential_(engine_); }
  Eigen::Vector3d normal3(double sigma) {
    const double x = normal(sigma);
    const double y = normal(sigma);
    const double z = normal(sigma);
    return {x, y, z};
  }
  Eigen::Vector3d direction() {
    Eigen::Vector3d v = normal3(1.0);
    while (v.norm() < 1e-3) {
      v = normal3(1.0);
    }
    return v.normalized();
  }

private:
  static std::uint64_t mix(std::uint64_t seed, std::string_view stream) {
    std::uint64_t hash = 0xcbf29ce484222325U; // FNV-1a of the name
    for (const char c : stream) {
      hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
    }
    hash += 0x9e3779b97f4a7c15U * (seed + 1); // splitmix64's finaliser
    hash = (hash ^ (hash >> 30U)) * 0xbf58476d1ce4e5b9U;
    hash = (hash ^ (hash >> 27U)) * 0x94d049bb133111ebU;
    return hash ^ (hash >> 31U);
  }

  std::mt19937_64 engine_;
  std::uniform_real_distribution<double> unit_{0.0, 1.0};
  std::normal_distribution<double> normal_{0.0, 1.0};
  std::exponential_distribution<double> exponential_{1.0};
};

} // namespace bregma::sim
