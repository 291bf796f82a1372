// Common output of registrations of files, as text and as JSON: the transform in both directions, residuals, predicted
// errors, verdicts.
#pragma once

#include <initializer_list>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "algorithms/geometry/pose_covariance.hpp"
#include "casefile/case.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/registration/registration_files.hpp"

namespace bregma::cli {

// The name and four rows.
[[nodiscard]] std::string matrix_text(const std::string &name, const Eigen::Matrix4d &m);
// "T_target_source" and four rows; then its inverse.
[[nodiscard]] std::string transforms_text(const Eigen::Matrix4d &T_target_source);
// Both directions, and their frames: the files, in RAS and mm.
[[nodiscard]] nlohmann::json transforms_json(const Eigen::Matrix4d &T_target_source, const RegistrationFiles &files);

// Covariance of a rigid transform: the 6x6 matrix and the names of its rows.
void add_covariance(nlohmann::json &out, const geometry::Matrix6d &covariance);

struct PointError {
  std::string name;
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero(); // in the target's frame
  double tre_rms_mm = 0.0;
  double within_95_mm = 0.0; // longest semi-axis of the 95 % region
};
// Predicted errors at points of the target's frame.
[[nodiscard]] std::vector<PointError> errors_at(const std::vector<casefile::NamedPoint> &targets,
                                                const geometry::Matrix6d &covariance);
[[nodiscard]] std::string errors_text(const std::vector<PointError> &errors);
[[nodiscard]] nlohmann::json errors_json(const std::vector<PointError> &errors);

// The points of a --targets file, in the frame, space and unit of the target; empty without a file.
[[nodiscard]] base::Result<PointFile> read_targets(const std::string &file, const InputFile &target);

// The notes of several files.
[[nodiscard]] std::vector<std::string> joined(std::initializer_list<std::vector<std::string>> lists);

// Writes files.tfm if requested; returns kOk, or the result of fail().
int write_tfm(const RegistrationFiles &files, const Eigen::Matrix4d &T_target_source);

// Transforms, covariance and predicted errors of a refused registration, and the poses that were compared: null.
void withhold_pose(nlohmann::json &document);
// refuse() for a registration, whose pose is withheld. Nothing is written.
int refuse_registration(const std::string &verdict, const std::string &reason, const Context &context,
                        nlohmann::json document = nlohmann::json::object());

} // namespace bregma::cli
