#include "casefile/case_images.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include <Eigen/Eigenvalues>

#include "base/text.hpp"
#include "base/toml_values.hpp"
#include "casefile/itk_transform.hpp"
#include "casefile/markups.hpp"
#include "casefile/sha256.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;
using geometry::Matrix6d;

constexpr std::size_t kMaxImages = 8;
constexpr std::size_t kUpperTriangle = 21;
// A registration with a larger predicted error, RMS at the centre of the head, does not help to navigate.
constexpr double kMaxImageError_mm = 10.0;

// Upper triangle, row by row.
Matrix6d matrix_of_upper(const std::vector<double> &upper) {
  Matrix6d out;
  std::size_t i = 0;
  for (Eigen::Index row = 0; row < 6; ++row) {
    for (Eigen::Index column = row; column < 6; ++column) {
      out(row, column) = out(column, row) = upper[i++];
    }
  }
  return out;
}

std::string upper_text(const Matrix6d &covariance) {
  std::string out;
  for (Eigen::Index row = 0; row < 6; ++row) {
    out += row == 0 ? "\n  " : ",\n  ";
    for (Eigen::Index column = row; column < 6; ++column) {
      out += (column == row ? "" : ", ") + base::detail::to_toml_text(covariance(row, column));
    }
  }
  return "[" + out + "\n]";
}

bool blank(const std::string &text) { return base::trimmed(text).empty(); }

void map_end(const Case &c, const std::string &placed_in, Eigen::Vector3d &end_mm) {
  if (const RegisteredImage *image = c.registered_image(placed_in); image != nullptr) {
    end_mm = image->T_image_source.pose * end_mm;
  }
}

// The position in the image in which it was placed, as files state it.
Eigen::Vector3d as_placed(const Case &c, const std::string &placed_in, const Eigen::Vector3d &image_mm) {
  const RegisteredImage *image = c.registered_image(placed_in);
  return image == nullptr ? image_mm : Eigen::Vector3d(image->T_image_source.pose.inverse() * image_mm);
}

std::optional<detail::CaseProblem> covariance_problem(const Case &c, const RegisteredImage &image,
                                                      const std::string &key) {
  const Matrix6d &covariance = image.T_image_source.covariance;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(covariance, Eigen::EigenvaluesOnly);
  if (!covariance.allFinite() || !(solver.eigenvalues().minCoeff() > -1e-9 * solver.eigenvalues().maxCoeff())) {
    return detail::CaseProblem{key + ".covariance", "is not that of an error: a variance is zero or negative"};
  }
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d &vertex : c.scalp.mesh.vertices_mm) {
    centre += vertex / static_cast<double>(c.scalp.mesh.vertices_mm.size());
  }
  const geometry::Matrix36d J = geometry::point_jacobian(centre);
  const double rms = std::sqrt((J * covariance * J.transpose()).trace());
  if (!(rms > 0.0 && rms <= kMaxImageError_mm)) {
    return detail::CaseProblem{key + ".covariance",
                               "predicts an error of " + base::detail::to_plain_text(rms) +
                                   " mm (RMS) at the centre of the head; it must be above 0 and at most 10 mm"};
  }
  return std::nullopt;
}

// A name that no image of the case has.
std::optional<std::string> unknown_image(const Case &c, const std::string &name) {
  if (name.empty() || c.registered_image(name) != nullptr) {
    return std::nullopt;
  }
  std::string names;
  for (const RegisteredImage &image : c.images) {
    names += (names.empty() ? "there are \"" : ", \"") + image.name + "\"";
  }
  return "image \"" + name + "\", which the case does not have; " + (names.empty() ? "it has no second image" : names);
}

std::optional<detail::CaseProblem> placing_problem(const Case &c) {
  for (const NamedPoint &fiducial : c.fiducials) {
    if (!fiducial.placed_in.empty()) {
      return detail::CaseProblem{"fiducials", "\"" + fiducial.name + "\" is placed in image \"" + fiducial.placed_in +
                                                  "\": fiducials are placed in the planning image, because the error "
                                                  "of another image would be common to all of them"};
    }
  }
  for (const auto &[key, points] :
       {std::pair{"landmarks", &c.landmarks}, {"brain_landmarks", &c.brain_landmarks}, {"targets", &c.targets}}) {
    for (const NamedPoint &point : *points) {
      if (auto what = unknown_image(c, point.placed_in)) {
        return detail::CaseProblem{key, "\"" + point.name + "\" is placed in " + *what};
      }
    }
  }
  for (const Trajectory &line : c.trajectories) {
    for (const std::string &end : {line.entry_in, line.target_in}) {
      if (auto what = unknown_image(c, end)) {
        return detail::CaseProblem{"trajectories", "\"" + line.name + "\" is placed in " + *what};
      }
    }
  }
  if (auto what = unknown_image(c, c.brain.segmented_in)) {
    return detail::CaseProblem{"surfaces.brain_image", "names " + *what};
  }
  for (std::size_t i = 0; i < c.structures.size(); ++i) {
    if (auto what = unknown_image(c, c.structures[i].segmented_in)) {
      return detail::CaseProblem{"structures[" + std::to_string(i) + "].image", "names " + *what};
    }
  }
  return std::nullopt;
}

std::string key_line(const char *key, const std::string &value) {
  return value.empty() ? "" : std::string(key) + " = " + base::detail::to_toml_text(value) + "\n";
}

// Writes the points that were placed in this image, and returns the keys that name the files.
base::Result<std::string> save_plans(const Case &c, const std::string &image, const std::string &stem) {
  std::string out;
  for (const auto &[key, points] :
       {std::pair{"landmarks", &c.landmarks}, {"brain_landmarks", &c.brain_landmarks}, {"targets", &c.targets}}) {
    std::vector<NamedPoint> here;
    for (const NamedPoint &point : *points) {
      if (point.placed_in == image) {
        here.push_back(point);
        here.back().position_mm = as_placed(c, image, point.position_mm);
      }
    }
    const std::string file = stem + "." + key + ".mrk.json";
    if (auto written = here.empty() ? base::Result<void>() : write_points(c.folder / file, key, here); !written) {
      return tl::unexpected(written.error());
    }
    out += here.empty() ? "" : key_line(key, file);
  }
  std::vector<Trajectory> here;
  for (const Trajectory &trajectory : c.trajectories) {
    if (trajectory.entry_in == image && trajectory.target_in == image) {
      here.push_back({trajectory.name, as_placed(c, image, trajectory.entry_mm),
                      as_placed(c, image, trajectory.target_mm), image, image});
    }
  }
  const std::string file = stem + ".trajectories.mrk.json";
  if (auto written = here.empty() ? base::Result<void>() : write_trajectories(c.folder / file, here); !written) {
    return tl::unexpected(written.error());
  }
  return out + (here.empty() ? "" : key_line("trajectories", file));
}

} // namespace

void map_to_image(const Case &c, NamedPoint &point) {
  if (const RegisteredImage *image = c.registered_image(point.placed_in); image != nullptr) {
    point.placing_covariance_mm2 = geometry::point_covariance(image->T_image_source, point.position_mm);
    point.position_mm = image->T_image_source.pose * point.position_mm;
  }
}

void map_to_image(const Case &c, Trajectory &trajectory) {
  map_end(c, trajectory.entry_in, trajectory.entry_mm);
  map_end(c, trajectory.target_in, trajectory.target_mm);
}

void put_image(Case &c, RegisteredImage image) {
  const auto at = std::find_if(c.images.begin(), c.images.end(),
                               [&image](const RegisteredImage &other) { return other.name == image.name; });
  if (at == c.images.end()) {
    c.images.push_back(std::move(image));
    return;
  }
  const Case before = c;
  *at = std::move(image);
  for (auto *points : {&c.landmarks, &c.brain_landmarks, &c.targets}) {
    for (NamedPoint &point : *points) {
      if (point.placed_in == at->name) {
        point.position_mm = as_placed(before, point.placed_in, point.position_mm);
        map_to_image(c, point);
      }
    }
  }
  for (Trajectory &trajectory : c.trajectories) {
    trajectory.entry_mm = as_placed(before, trajectory.entry_in, trajectory.entry_mm);
    trajectory.target_mm = as_placed(before, trajectory.target_in, trajectory.target_mm);
    map_to_image(c, trajectory);
  }
  const auto moved = at->T_image_source.pose * before.registered_image(at->name)->T_image_source.pose.inverse();
  const auto move = [&](Surface &surface) {
    for (Eigen::Vector3d &vertex : surface.mesh.vertices_mm) {
      vertex = surface.segmented_in == at->name ? Eigen::Vector3d(moved * vertex) : vertex;
    }
  };
  move(c.brain);
  std::for_each(c.structures.begin(), c.structures.end(), move);
}

namespace detail {

ImageFiles read_image(base::TableReader &reader, RegisteredImage &out) {
  ImageFiles files;
  out.name = reader.require_string("name");
  files.file = reader.string("file", "");
  files.transform = reader.require_string("transform");
  out.T_image_source.covariance = matrix_of_upper(reader.require_numbers("covariance", kUpperTriangle));
  out.measure = reader.string("measure", "");
  out.verdict = reader.require_choice("verdict", {"found", "ambiguous", "refused", "unknown"});
  out.accepted = reader.string("accepted", "");
  out.date = reader.string("date", "");
  out.sha256 = reader.string("sha256", "");
  out.planning_sha256 = reader.require_string("planning_sha256");
  files.landmarks = reader.string("landmarks", "");
  files.brain_landmarks = reader.string("brain_landmarks", "");
  files.targets = reader.string("targets", "");
  files.trajectories = reader.string("trajectories", "");
  static_cast<void>(reader.finish());
  return files;
}

std::optional<CaseProblem> load_image(const fs::path &folder, const ImageFiles &files, RegisteredImage &out,
                                      Checksums checksums) {
  const auto T = read_itk_rigid(folder / files.transform);
  if (!T) {
    return CaseProblem{"transform", T.error().message};
  }
  out.T_image_source.pose = T->as<geometry::frame::Image, geometry::frame::Source>();
  if (files.file.empty()) {
    return std::nullopt;
  }
  out.file = folder / files.file;
  if (checksums == Checksums::kIgnore) {
    return std::nullopt;
  }
  const auto hash = sha256_of_file(out.file);
  if (!hash) {
    return CaseProblem{"file", hash.error().message};
  }
  if (to_hex(*hash) != out.sha256) {
    return CaseProblem{"sha256", "the image " + out.file.string() +
                                     " has changed since it was registered: register it again (bregma image add)"};
  }
  return std::nullopt;
}

std::optional<CaseProblem> changed_planning_image(const Case &c) {
  const auto hash = sha256_of_file(c.image);
  if (!hash) {
    return CaseProblem{"image", hash.error().message};
  }
  for (std::size_t i = 0; i < c.images.size(); ++i) {
    if (c.images[i].planning_sha256 != to_hex(*hash)) {
      return CaseProblem{"images[" + std::to_string(i) + "].planning_sha256",
                         "the planning image has changed since image \"" + c.images[i].name +
                             "\" was registered to it: register it again (bregma image add)"};
    }
  }
  return std::nullopt;
}

std::optional<CaseProblem> images_problem(const Case &c) {
  if (c.images.size() > kMaxImages) {
    return CaseProblem{"images", std::to_string(c.images.size()) + " images, at most " + std::to_string(kMaxImages) +
                                     " are allowed"};
  }
  for (std::size_t i = 0; i < c.images.size(); ++i) {
    const RegisteredImage &image = c.images[i];
    const std::string key = "images[" + std::to_string(i) + "]";
    if (image.verdict != "found" && blank(image.accepted)) {
      return CaseProblem{key + ".verdict", "is not \"found\", and \"accepted\" does not state why it is used"};
    }
    if (auto problem = covariance_problem(c, image, key)) {
      return problem;
    }
  }
  return placing_problem(c);
}

std::vector<NamedPoint> placed_in_planning_image(const std::vector<NamedPoint> &points) {
  std::vector<NamedPoint> out;
  std::copy_if(points.begin(), points.end(), std::back_inserter(out),
               [](const NamedPoint &point) { return point.placed_in.empty(); });
  return out;
}

std::vector<Trajectory> written_with_the_plan(const Case &c) {
  std::vector<Trajectory> out;
  for (const Trajectory &trajectory : c.trajectories) {
    if (trajectory.entry_in.empty() || trajectory.entry_in != trajectory.target_in) {
      out.push_back(trajectory);
      out.back().entry_mm = as_placed(c, trajectory.entry_in, trajectory.entry_mm);
      out.back().target_mm = as_placed(c, trajectory.target_in, trajectory.target_mm);
    }
  }
  return out;
}

base::Result<std::string> save_images(const Case &c) {
  std::string out;
  std::set<std::string> taken;
  std::error_code error;
  for (const RegisteredImage &image : c.images) {
    const std::string stem = "images/" + file_stem(image.name, taken);
    fs::create_directories(c.folder / "images", error);
    if (auto written = write_itk_transform(c.folder / (stem + ".tfm"), image.T_image_source.pose.matrix()); !written) {
      return tl::unexpected(written.error());
    }
    auto plans = save_plans(c, image.name, stem);
    if (!plans) {
      return plans;
    }
    out += "\n# Registered to the planning image; points placed in it are in its own coordinates.\n[[images]]\n" +
           key_line("name", image.name) +
           key_line("file", image.file.empty() ? "" : image.file.lexically_relative(c.folder).generic_string()) +
           key_line("transform", stem + ".tfm") + "covariance = " + upper_text(image.T_image_source.covariance) + "\n" +
           key_line("measure", image.measure) + key_line("verdict", image.verdict) +
           key_line("accepted", image.accepted) + key_line("date", image.date) + key_line("sha256", image.sha256) +
           key_line("planning_sha256", image.planning_sha256) + *plans;
  }
  return out;
}

} // namespace detail

} // namespace bregma::casefile
