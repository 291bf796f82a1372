// Common parts of the studies of points, clouds, splines and curves.
#pragma once

#include <chrono>
#include <filesystem>

#include "bench/record.hpp"

namespace bregma::bench {

inline constexpr unsigned kStudySeed = 20260315;
inline const std::filesystem::path kShared = "../shared/data"; // real recordings, not part of the repository

template <class Task> double milliseconds(Task &&task) {
  const auto start = std::chrono::steady_clock::now();
  task();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

inline bool is_present(const Report &report, const std::filesystem::path &path) {
  const bool here = std::filesystem::exists(path);
  if (!here) {
    report.note(path.string() + " is not here: its figures are left out");
  }
  return here;
}

} // namespace bregma::bench
