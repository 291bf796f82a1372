// `bregma register points`: rigid registration of two lists of points in files.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

struct RegisterPointsArguments {
  std::string source, target;
  // 1-sigma error of a coordinate, both lists together. Without it, it is estimated from the residuals.
  std::optional<double> sigma_mm;
  std::vector<double> at_mm; // a point in source coordinates to predict the TRE at; empty or three numbers
};

int register_points(const RegisterPointsArguments &arguments, const Context &context);

} // namespace bregma::cli
