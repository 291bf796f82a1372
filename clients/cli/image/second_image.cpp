#include "clients/cli/image/second_image.hpp"

#include <algorithm>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "algorithms/uncertainty/tre.hpp"
#include "casefile/markups.hpp"
#include "casefile/volumes/second_image.hpp"
#include "clients/cli/case/progress_line.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"

namespace bregma::cli {

namespace {

namespace fs = std::filesystem;
using casefile::Case;
using casefile::NamedPoint;
using casefile::RegisteredImage;
using casefile::Trajectory;
using nlohmann::json;

constexpr double kFromCentre_mm = 60.0;

Eigen::Vector3d head_centre(const Case &c) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d &vertex : c.scalp.mesh.vertices_mm) {
    sum += vertex;
  }
  return sum / static_cast<double>(std::max<std::size_t>(c.scalp.mesh.vertices_mm.size(), 1));
}

// Predicted error of the registration, RMS, at the centre of the head, and the largest one 60 mm from it along the
// axes.
std::pair<double, double> error_rms_mm(const Case &c, const RegisteredImage &image) {
  const Eigen::Vector3d centre = head_centre(c);
  const auto rms = [&](const Eigen::Vector3d &at) {
    return uncertainty::rms_mm(uncertainty::tre_covariance(image.T_image_source.covariance, at));
  };
  double away = 0.0;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    for (const double side : {-kFromCentre_mm, kFromCentre_mm}) {
      away = std::max(away, rms(centre + side * Eigen::Vector3d::Unit(axis)));
    }
  }
  return {rms(centre), away};
}

// Replaces the item of the same name that was placed in this image, or appends it.
template <class Item, class Here> void put(std::vector<Item> &items, Item item, Here placed_here) {
  const auto at = std::find_if(items.begin(), items.end(),
                               [&](const Item &other) { return other.name == item.name && placed_here(other); });
  if (at != items.end()) {
    *at = std::move(item);
  } else {
    items.push_back(std::move(item));
  }
}

base::Result<void> add_points(Case &c, const std::string &image, const std::string &file,
                              std::vector<NamedPoint> &points) {
  if (file.empty()) {
    return {};
  }
  auto read = casefile::read_points(file);
  if (!read) {
    return tl::unexpected(read.error());
  }
  for (NamedPoint &point : *read) {
    if (!point.placed_in.empty() && point.placed_in != image) {
      return base::failure(file + ": \"" + point.name + "\" was placed in image \"" + point.placed_in +
                           "\", not in \"" + image + "\"");
    }
    point.placed_in = image;
    map_to_image(c, point);
    put(points, std::move(point), [&](const NamedPoint &other) { return other.placed_in == image; });
  }
  return {};
}

base::Result<void> add_trajectories(Case &c, const std::string &image, const std::string &file) {
  if (file.empty()) {
    return {};
  }
  auto read = casefile::read_trajectories(file);
  if (!read) {
    return tl::unexpected(read.error());
  }
  for (Trajectory &line : *read) {
    line.entry_in = line.target_in = image;
    map_to_image(c, line);
    put(c.trajectories, std::move(line), [&](const Trajectory &other) { return other.target_in == image; });
  }
  return {};
}

// Structures of a segmentation that was drawn on the image. Their surfaces are made on its grid, where its voxels are,
// and then moved to the planning image.
base::Result<void> add_structures(Case &c, const SecondImage &image, const intensity::Volume &volume,
                                  std::vector<std::string> &notes) {
  const auto maker = casefile::StructureMaker::read(image.segmentation, image.space, &notes);
  if (!maker) {
    return tl::unexpected(maker.error());
  }
  for (std::string &doubt : maker->doubts(volume)) {
    notes.push_back(std::move(doubt));
  }
  ProgressLine progress;
  auto made =
      maker->make(image.vertices, [&](double done, std::string_view stage) { return progress.show(done, stage); });
  if (!made) {
    return tl::unexpected(made.error());
  }
  const auto &T_image_source = c.registered_image(image.name)->T_image_source.pose;
  for (casefile::Surface &structure : made->surfaces) {
    for (Eigen::Vector3d &vertex : structure.mesh.vertices_mm) {
      vertex = T_image_source * vertex;
    }
    structure.segmented_in = image.name;
    put(c.structures, std::move(structure),
        [&](const casefile::Surface &other) { return other.segmented_in == image.name; });
  }
  return {};
}

} // namespace

base::Result<Case> add_to_case(const fs::path &folder, const SecondImage &image, const intensity::Volume &volume,
                               const casefile::ImageRegistration &registration, bool replace,
                               std::vector<std::string> &notes) {
  auto loaded = load_case(folder, casefile::Checksums::kIgnore);
  if (!loaded) {
    return loaded;
  }
  if (!replace && loaded->registered_image(image.name) != nullptr) {
    return base::failure(folder.string() + ": the case has an image \"" + image.name + "\"; --replace replaces it");
  }
  if (auto added = add_image(*loaded, image.source, volume, registration, image.name, image.accepted); !added) {
    return tl::unexpected(added.error());
  }
  const PlanFiles &plans = image.plans;
  for (const auto &[file, points] : {std::pair{&plans.targets, &loaded->targets},
                                     {&plans.landmarks, &loaded->landmarks},
                                     {&plans.brain_landmarks, &loaded->brain_landmarks}}) {
    if (auto added = add_points(*loaded, image.name, *file, *points); !added) {
      return tl::unexpected(added.error());
    }
  }
  if (auto added = add_trajectories(*loaded, image.name, plans.trajectories); !added) {
    return tl::unexpected(added.error());
  }
  if (auto added = add_structures(*loaded, image, volume, notes); !added) {
    return tl::unexpected(added.error());
  }
  if (auto sound = check_case(*loaded); !sound) {
    return tl::unexpected(sound.error());
  }
  if (auto saved = save_case(*loaded); !saved) {
    return tl::unexpected(saved.error());
  }
  return loaded;
}

std::vector<std::string> placed_in(const Case &c, const std::string &image) {
  std::vector<std::string> out;
  for (const auto &[kind, points] :
       {std::pair{"target ", &c.targets}, {"landmark ", &c.landmarks}, {"brain landmark ", &c.brain_landmarks}}) {
    for (const NamedPoint &point : *points) {
      if (point.placed_in == image) {
        out.push_back(kind + point.name);
      }
    }
  }
  for (const Trajectory &line : c.trajectories) {
    if (line.entry_in == image || line.target_in == image) {
      out.push_back("trajectory " + line.name);
    }
  }
  for (const casefile::Surface &structure : c.structures) {
    if (structure.segmented_in == image) {
      out.push_back("structure " + structure.name);
    }
  }
  if (c.brain.segmented_in == image) {
    out.emplace_back("the brain");
  }
  return out;
}

std::string image_text(const Case &c, const RegisteredImage &image) {
  const auto [centre, away] = error_rms_mm(c, image);
  std::string out = printable(image.name) + ": " + (image.file.empty() ? "registration only" : image.file.string()) +
                    "\n  predicted error of its registration " + fixed(centre, 2, "mm") +
                    " RMS at the centre of the head, " + fixed(away, 2, "mm") + " at 60 mm from it\n  verdict " +
                    image.verdict + (image.measure.empty() ? "" : ", by " + printable(image.measure)) +
                    (image.date.empty() ? "" : ", " + printable(image.date)) + "\n";
  out += image.accepted.empty() ? "" : "  accepted by a person: " + printable(image.accepted) + "\n";
  for (const std::string &item : placed_in(c, image.name)) {
    out += "  in its coordinates: " + printable(item) + "\n";
  }
  return out;
}

json image_json(const Case &c, const RegisteredImage &image) {
  const auto [centre, away] = error_rms_mm(c, image);
  return {{"name", image.name},
          {"file", image.file.string()},
          {"T_image_source", json_matrix(image.T_image_source.pose.matrix())},
          {"covariance", json_matrix(image.T_image_source.covariance)},
          {"error_rms_mm", json_number(centre)},
          {"error_at_60_mm_rms_mm", json_number(away)},
          {"measure", image.measure},
          {"verdict", image.verdict},
          {"accepted", image.accepted},
          {"date", image.date},
          {"placed_in_it", placed_in(c, image.name)}};
}

json identity_json(const casefile::ImageIdentity &identity) {
  return {{"size", identity.size},
          {"T_ras_voxel", json_matrix(identity.T_ras_voxel)},
          {"voxels_sha256", identity.voxels_sha256}};
}

} // namespace bregma::cli
