#include "clients/cli/registration/registration_output.hpp"

#include <Eigen/LU>

#include "algorithms/uncertainty/tre.hpp"
#include "casefile/itk_transform.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"

namespace bregma::cli {

using nlohmann::json;

std::string matrix_text(const std::string &name, const Eigen::Matrix4d &m) {
  Table table({"", "", "", ""});
  for (Eigen::Index i = 0; i < 4; ++i) {
    table.row({fixed(m(i, 0), 6), fixed(m(i, 1), 6), fixed(m(i, 2), 6), fixed(m(i, 3), 4)});
  }
  return name + "\n" + table.text().substr(1); // removes the empty header
}

std::string transforms_text(const Eigen::Matrix4d &T_target_source) {
  return matrix_text("T_target_source", T_target_source) + "\n" +
         matrix_text("T_source_target", T_target_source.inverse());
}

json transforms_json(const Eigen::Matrix4d &T_target_source, const RegistrationFiles &files) {
  return {{"T_target_source", json_matrix(T_target_source)},
          {"T_source_target", json_matrix(T_target_source.inverse())},
          {"frames", {{"source", files.source.path}, {"target", files.target.path}, {"axes", "RAS"}, {"unit", "mm"}}}};
}

void add_covariance(json &out, const geometry::Matrix6d &covariance) {
  out["covariance"] = json_matrix(covariance);
  out["covariance_order"] = "rotation (rad), translation (mm); left perturbation in the target frame";
}

std::vector<PointError> errors_at(const std::vector<casefile::NamedPoint> &targets,
                                  const geometry::Matrix6d &covariance) {
  std::vector<PointError> out;
  for (const casefile::NamedPoint &target : targets) {
    const geometry::Matrix3d of_target = uncertainty::tre_covariance(covariance, target.position_mm);
    out.push_back({target.name, target.position_mm, uncertainty::rms_mm(of_target),
                   uncertainty::ellipsoid_95(of_target).semi_axes_mm.x()});
  }
  return out;
}

std::string errors_text(const std::vector<PointError> &errors) {
  Table table({"Target", "Position mm", "Predicted TRE mm (RMS)", "95 % within mm"});
  for (const PointError &error : errors) {
    table.row({printable(error.name), vector_text(error.position_mm, 1), fixed(error.tre_rms_mm, 3),
               fixed(error.within_95_mm, 3)});
  }
  return errors.empty() ? "" : "\n" + table.text();
}

json errors_json(const std::vector<PointError> &errors) {
  json out = json::array();
  for (const PointError &error : errors) {
    out.push_back({{"target", error.name},
                   {"position_mm", json_vector(error.position_mm)},
                   {"tre_rms_mm", json_number(error.tre_rms_mm)},
                   {"within_95_mm", json_number(error.within_95_mm)}});
  }
  return out;
}

base::Result<PointFile> read_targets(const std::string &file, const InputFile &target) {
  if (file.empty()) {
    return PointFile();
  }
  // Lesions may be close to each other.
  auto read = read_point_file(file, target.point_options({0.0, casefile::kPointsSize.largest_mm}));
  if (read && read->points.empty()) {
    std::string why;
    for (const std::string &note : read->notes) {
      why += "; note that " + note;
    }
    return base::failure(file + ": holds no points" + why);
  }
  for (std::size_t i = 0; read && i < read->points.size(); ++i) {
    for (std::size_t other = 0; other < i; ++other) {
      if (read->named && read->points[i].name == read->points[other].name) {
        return base::failure(file + ": two points are called \"" + read->points[i].name + "\"");
      }
    }
  }
  return read;
}

std::vector<std::string> joined(std::initializer_list<std::vector<std::string>> lists) {
  std::vector<std::string> out;
  for (const std::vector<std::string> &list : lists) {
    out.insert(out.end(), list.begin(), list.end());
  }
  return out;
}

int write_tfm(const RegistrationFiles &files, const Eigen::Matrix4d &T_target_source) {
  if (files.tfm.empty()) {
    return kOk;
  }
  const auto written = casefile::write_itk_transform(files.tfm, T_target_source);
  return written ? static_cast<int>(kOk) : fail(written.error());
}

int refuse_registration(const std::string &verdict, const std::string &reason, const Context &context, json document) {
  withhold_pose(document);
  return refuse(verdict, reason, context, std::move(document));
}

void withhold_pose(json &document) {
  withhold(document, {"T_target_source", "T_source_target", "covariance", "targets"});
  for (const char *poses : {"hypotheses", "candidates"}) {
    if (const auto found = document.find(poses); found != document.end()) {
      for (json &pose : *found) {
        withhold(pose, {"T_target_source"});
      }
    }
  }
}

} // namespace bregma::cli
