// The arm that ships with Bregma, and random joint angles of it.
#pragma once

#include <filesystem>
#include <random>
#include <stdexcept>

#include "casefile/arm_files/arm_file.hpp"

namespace bregma::test {

inline robot::ArmModel mz07f() {
  auto arm = casefile::read_arm(std::filesystem::path(BREGMA_SOURCE_DIR) / "robots/mz07f.toml");
  if (!arm) {
    throw std::runtime_error(arm.error().message);
  }
  return *arm;
}

inline robot::JointAngles random_joints(const robot::ArmModel &arm, std::mt19937 &rng) {
  robot::JointAngles out;
  for (std::size_t i = 0; i < robot::kJoints; ++i) {
    const robot::JointLimits &limits = arm.limits()[i];
    out[static_cast<Eigen::Index>(i)] = std::uniform_real_distribution<double>(limits.lower_rad, limits.upper_rad)(rng);
  }
  return out;
}

} // namespace bregma::test
