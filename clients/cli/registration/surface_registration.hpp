// Registration of samples of the skin onto the surface of a head, with its verdict and its output: the common part of
// `bregma register surface` and `bregma register scan`.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "algorithms/registration/points/paired_points.hpp"
#include "casefile/case.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/registration/cloud_file.hpp"
#include "clients/cli/registration/registration_files.hpp"

namespace bregma::cli {

struct SurfaceArguments {
  RegistrationFiles files;
  std::string start; // a .tfm file; empty: from any pose
  double sigma_mm = 1.0;
  double outliers = 0.05;
  std::string targets;
};
// --start, --sigma-mm, --outliers, --targets.
void add_surface_options(CLI::App &command, SurfaceArguments &arguments);

// Input other than the samples.
struct SurfaceInput {
  surface::TriangleMesh surface; // RAS, mm
  std::vector<casefile::NamedPoint> targets;
  std::optional<registration::PairedPose> start;
  std::vector<std::string> notes;
};
[[nodiscard]] base::Result<SurfaceInput> read_surface_input(const SurfaceArguments &arguments);

// The sensor that measured all samples along one direction, and the errors that they have in common
// (algorithms/registration/surface/beam_errors.hpp).
struct ScanningBeam {
  Eigen::Vector3d towards_sensor = Eigen::Vector3d::UnitZ(); // unit, in the frame of the samples
  double offset_sigma_mm = 0.0;
  double excess_sigma_mm = 0.0;
};

// Prints the verdict and, if a pose was found, the pose and its predicted errors; writes --tfm. Returns the exit code.
// document: what the command's JSON holds in addition.
int register_samples(const SurfaceArguments &arguments, const Cloud &samples, const SurfaceInput &input,
                     const std::optional<ScanningBeam> &beam, nlohmann::json document, const Context &context);

} // namespace bregma::cli
