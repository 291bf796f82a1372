#include "clients/case_server/case_bundle.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "algorithms/surface/triangle_mesh.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"
#include "case_model/brain.hpp"
#include "casefile/case.hpp"
#include "casefile/volumes/crop.hpp"
#include "casefile/volumes/label_regions.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::case_server {
namespace {

using casefile::Case;
using nlohmann::json;

// Okabe and Ito's colours, which are told apart also with a colour vision deficiency.
constexpr std::array kColours{"#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7", "#999999"};
constexpr const char *kScalpColour = "#d9b8a0";
constexpr const char *kBrainColour = "#e8b4b8";

json vector(const Eigen::Vector3d &v) { return {v.x(), v.y(), v.z()}; }

// A point that was placed in a second image states it, and the part of its error.
json points(const std::vector<casefile::NamedPoint> &list) {
  json out = json::array();
  for (const auto &point : list) {
    out.push_back({{"name", point.name}, {"position_mm", vector(point.position_mm)}});
    if (!point.placed_in.empty()) {
      out.back()["placed_in"] = point.placed_in;
      out.back()["image_rms_mm"] = std::sqrt(point.placing_covariance_mm2.trace());
    }
  }
  return out;
}

json rows(const Eigen::MatrixXd &matrix) {
  json out = json::array();
  for (Eigen::Index row = 0; row < matrix.rows(); ++row) {
    for (Eigen::Index column = 0; column < matrix.cols(); ++column) {
      out.push_back(matrix(row, column));
    }
  }
  return out;
}

json trajectories(const Case &c) {
  json out = json::array();
  for (const auto &line : c.trajectories) {
    out.push_back({{"name", line.name}, {"entry_mm", vector(line.entry_mm)}, {"target_mm", vector(line.target_mm)}});
  }
  return out;
}

json tools(const Case &c) {
  constexpr std::array kRoles{"reference", "pointer", "probe"};
  json out = json::array();
  for (const auto &tool : c.tools) {
    json markers = json::array();
    for (const auto &marker : tool.markers_mm) {
      markers.push_back(vector(marker));
    }
    out.push_back({{"name", tool.name},
                   {"role", kRoles.at(static_cast<std::size_t>(tool.role))},
                   {"axis", vector(tool.axis)},
                   {"normal", vector(tool.normal)},
                   {"tip_mm", vector(tool.nominal_tip_mm)},
                   {"markers_mm", std::move(markers)},
                   {"carried", c.carried_by_arm(tool.name)}});
  }
  return out;
}

// null: there is no tracker beside an arm.
json hand_eye(const Case &c) {
  if (c.hand_eye() == nullptr) {
    return nullptr;
  }
  json T_base_tracker = json::array();
  const Eigen::Matrix4d T = c.hand_eye()->T_base_tracker.pose.matrix();
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      T_base_tracker.push_back(T(row, column));
    }
  }
  return {{"tracker", c.hand_eye()->tracker}, {"T_base_tracker", std::move(T_base_tracker)}};
}

// The patient's side of the planned targets, or of all targets without a trajectory. +x is right in RAS.
std::string side(const Case &c) {
  std::vector<double> x;
  for (const auto &line : c.trajectories) {
    x.push_back(line.target_mm.x());
  }
  if (x.empty()) {
    for (const auto &target : c.targets) {
      x.push_back(target.position_mm.x());
    }
  }
  const bool right = std::any_of(x.begin(), x.end(), [](double value) { return value > 0.0; });
  const bool left = std::any_of(x.begin(), x.end(), [](double value) { return value < 0.0; });
  return right && left ? "both" : right ? "right" : left ? "left" : "";
}

template <class T> void append(std::vector<std::byte> &out, const T *values, std::size_t count) {
  const std::size_t at = out.size();
  out.resize(at + count * sizeof(T));
  std::memcpy(out.data() + at, values, count * sizeof(T));
}

std::vector<std::byte> mesh_bytes(const surface::TriangleMesh &mesh) {
  std::vector<std::byte> out;
  const std::array<std::uint32_t, 2> counts{static_cast<std::uint32_t>(mesh.vertices_mm.size()),
                                            static_cast<std::uint32_t>(mesh.triangles.size())};
  append(out, counts.data(), counts.size());
  for (const auto &vertex : mesh.vertices_mm) {
    const Eigen::Vector3f v = vertex.cast<float>();
    append(out, v.data(), 3);
  }
  for (const auto &triangle : mesh.triangles) {
    const Eigen::Matrix<std::uint32_t, 3, 1> t = triangle.cast<std::uint32_t>();
    append(out, t.data(), 3);
  }
  return out;
}

template <class T, class Voxel> std::vector<std::byte> voxels_as(const std::vector<Voxel> &voxels) {
  std::vector<T> values(voxels.size());
  std::transform(voxels.begin(), voxels.end(), values.begin(), [](Voxel v) { return static_cast<T>(v); });
  std::vector<std::byte> out;
  append(out, values.data(), values.size());
  return out;
}

struct Voxels {
  const char *type;
  std::vector<std::byte> bytes;
};

// The smallest type that holds every voxel exactly.
Voxels exact_voxels(const std::vector<float> &voxels, float lowest, float highest) {
  const bool whole = std::all_of(voxels.begin(), voxels.end(), [](float v) { return v == std::floor(v); });
  const auto fits = [&](auto type) {
    using Limits = std::numeric_limits<decltype(type)>;
    return whole && lowest >= static_cast<float>(Limits::min()) && highest <= static_cast<float>(Limits::max());
  };
  if (fits(std::uint8_t{})) {
    return {"uint8", voxels_as<std::uint8_t>(voxels)};
  }
  if (fits(std::int16_t{})) {
    return {"int16", voxels_as<std::int16_t>(voxels)};
  }
  if (fits(std::uint16_t{})) {
    return {"uint16", voxels_as<std::uint16_t>(voxels)};
  }
  return {"float32", voxels_as<float>(voxels)};
}

json percentiles(std::vector<float> voxels) {
  json out = json::array();
  for (const double percent : {1.0, 5.0, 50.0, 95.0, 99.0, 99.9}) {
    const auto rank = static_cast<std::ptrdiff_t>(percent / 100.0 * static_cast<double>(voxels.size() - 1));
    std::nth_element(voxels.begin(), voxels.begin() + rank, voxels.end());
    out.push_back({percent, voxels[static_cast<std::size_t>(rank)]});
  }
  return out;
}

class Builder {
public:
  explicit Builder(const Case &c) : case_(c) {
    root_ = {{"id", c.id},
             {"side", side(c)},
             {"image", nullptr},
             {"labels", nullptr},
             {"images", json::array()},
             {"meshes", json::array()},
             {"trajectories", trajectories(c)},
             {"targets", points(c.targets)},
             {"fiducials", points(c.fiducials)},
             {"landmarks", points(c.landmarks)},
             {"brain_landmarks", points(c.brain_landmarks)},
             {"tools", tools(c)},
             {"hand_eye", hand_eye(c)},
             {"limits", {{"max_check_mm", c.limits.max_check_mm}, {"max_target_tre_mm", c.limits.max_target_tre_mm}}}};
  }

  void add_image(const casefile::Volume &volume) { root_["image"] = voxel_entry(volume); }

  // The part with regions, in bytes where their numbers permit.
  void add_labels(const casefile::LabelVolume &volume, const casefile::LabelRegions &regions) {
    const casefile::LabelVolume part = casefile::cropped(volume, [](std::int16_t v) { return v != 0; });
    if (part.voxels.empty()) {
      return;
    }
    const auto [lowest, highest] = std::minmax_element(part.voxels.begin(), part.voxels.end());
    const bool small = *lowest >= 0 && *highest <= std::numeric_limits<std::uint8_t>::max();
    json entry = file(small ? voxels_as<std::uint8_t>(part.voxels) : voxels_as<std::int16_t>(part.voxels));
    entry["type"] = small ? "uint8" : "int16";
    entry["dims"] = part.size;
    entry["T_ras_voxel"] = rows(part.T_image_index);
    entry["regions"] = json::array();
    for (const auto &[value, region] : regions) {
      std::array<char, 8> colour{};
      std::snprintf(colour.data(), colour.size(), "#%06x", region.colour & 0xFFFFFFU);
      entry["regions"].push_back({{"value", value}, {"name", region.name}, {"colour", colour.data()}});
    }
    root_["labels"] = std::move(entry);
  }

  // T_ras_voxel leads to Image, as for every image; T_image_source leads there from the image's own coordinates.
  void add_registered(const casefile::RegisteredImage &image, const casefile::Volume &volume) {
    json entry = voxel_entry(volume);
    entry["T_ras_voxel"] = rows(image.T_image_source.pose.matrix() * volume.T_image_index);
    entry["name"] = image.name;
    entry["file"] = file_name(image.name);
    entry["T_image_source"] = rows(image.T_image_source.pose.matrix());
    entry["covariance"] = rows(image.T_image_source.covariance);
    entry["verdict"] = image.verdict;
    entry["accepted"] = image.accepted;
    root_["images"].push_back(std::move(entry));
  }

  void add_mesh(const std::string &name, const char *kind, const char *colour, double opacity,
                const surface::TriangleMesh &mesh) {
    json entry = file(mesh_bytes(mesh));
    entry["name"] = name;
    entry["file"] = file_name(name);
    entry["kind"] = kind;
    entry["colour"] = colour;
    entry["opacity"] = opacity;
    entry["vertices"] = mesh.vertices_mm.size();
    entry["triangles"] = mesh.triangles.size();
    root_["meshes"].push_back(std::move(entry));
  }

  casefiles::Bundle finish() {
    out_.case_id = case_.id;
    out_.manifest = root_.dump(-1, ' ', false, json::error_handler_t::replace);
    return std::move(out_);
  }

private:
  json voxel_entry(const casefile::Volume &volume) {
    const auto [lowest, highest] = std::minmax_element(volume.voxels.begin(), volume.voxels.end());
    Voxels voxels = exact_voxels(volume.voxels, *lowest, *highest);
    json entry = file(std::move(voxels.bytes));
    entry["type"] = voxels.type;
    entry["dims"] = volume.size;
    entry["T_ras_voxel"] = rows(volume.T_image_index);
    entry["min"] = *lowest;
    entry["max"] = *highest;
    entry["percentiles"] = percentiles(volume.voxels);
    return entry;
  }

  json file(std::vector<std::byte> bytes) {
    const casefile::Hash hash = casefile::sha256(std::span<const std::byte>(bytes));
    json out{{"sha256", casefile::to_hex(hash)}, {"bytes", bytes.size()}};
    out_.files[hash] = std::move(bytes);
    return out;
  }

  // A part of an address, unique in the case.
  std::string file_name(const std::string &name) {
    std::string stem;
    for (const char c : name.substr(0, 40)) {
      stem += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
    }
    std::string unique = stem;
    for (int i = 2; !names_.insert(unique).second; ++i) {
      unique = stem + "_" + std::to_string(i);
    }
    return unique;
  }

  const Case &case_;
  json root_;
  casefiles::Bundle out_;
  std::set<std::string> names_;
};

// All nodes of the tissue's mesh, in its order, and the triangles of its boundary. Empty for a brain that cannot be
// meshed: the daemon then has no model either.
surface::TriangleMesh tissue_surface(const Case &c, int elements) {
  case_model::BrainSettings settings;
  settings.mesh.lattice.tetrahedra = elements;
  const auto brain = case_model::brain_of(c, settings);
  surface::TriangleMesh out;
  if (brain) {
    const auto &mesh = brain->filled.mesh;
    out.vertices_mm = mesh.nodes_mm;
    out.triangles = tissue::boundary_of(mesh).triangles;
  }
  return out;
}

} // namespace

base::Result<casefiles::Bundle> bundle_of(const std::filesystem::path &folder, int tissue_elements) {
  const auto loaded = casefile::load_case(folder);
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  Builder builder(*loaded);
  casefile::Notes notes;
  const auto volume = casefile::read_volume(loaded->image, {}, &notes);
  if (!volume) {
    return tl::unexpected(volume.error());
  }
  builder.add_image(*volume);
  if (loaded->labels) {
    const auto labels = casefile::read_labels(loaded->labels->file, {}, &notes);
    const auto regions = casefile::read_label_regions(loaded->labels->table);
    if (!labels || !regions) {
      return tl::unexpected(labels ? regions.error() : labels.error());
    }
    builder.add_labels(*labels, *regions);
  }
  for (const auto &image : loaded->images) {
    if (image.file.empty()) {
      continue;
    }
    const auto second = casefile::read_volume(image.file, {}, &notes);
    if (!second) {
      return tl::unexpected(second.error());
    }
    builder.add_registered(image, *second);
  }
  builder.add_mesh("scalp", "scalp", kScalpColour, 0.25, loaded->scalp.mesh);
  builder.add_mesh("brain", "brain", kBrainColour, 0.5, loaded->brain.mesh);
  for (std::size_t i = 0; i < loaded->structures.size(); ++i) {
    const auto &structure = loaded->structures[i];
    builder.add_mesh(structure.name, "structure", kColours.at(i % kColours.size()), 1.0, structure.mesh);
  }
  if (tissue_elements > 0) {
    if (const auto tissue = tissue_surface(*loaded, tissue_elements); !tissue.vertices_mm.empty()) {
      builder.add_mesh("tissue", "tissue", kBrainColour, 1.0, tissue);
    }
  }
  return builder.finish();
}

} // namespace bregma::case_server
