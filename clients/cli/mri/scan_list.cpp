#include "clients/cli/mri/scan_list.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include <Eigen/Geometry>

#include "base/table_reader.hpp"
#include "casefile/coil_frames.hpp"
#include "casefile/volumes/scan_header.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/mri/read_out.hpp"

namespace bregma::cli {

namespace {

constexpr double kAligned = 0.999; // cosine of 2.6 degrees

struct Entry {
  std::string name, background, foreground, opposite, orientation;
  std::string background_opposed, foreground_opposed;
  std::vector<int> on, verify;
};

// Names of groups or coils as indices.
std::vector<int> coils_named(base::TableReader &table, const char *key, const mri::CoilFrame &frame) {
  std::vector<int> out;
  for (const std::string &word : table.strings(key)) {
    const std::size_t before = out.size();
    for (std::size_t i = 0; i < frame.coils.size(); ++i) {
      if (frame.coils[i].group == word || frame.coils[i].name == word) {
        out.push_back(static_cast<int>(i));
      }
    }
    if (out.size() == before) {
      table.refuse(key, "\"" + word + "\" is no coil and no group of the frame " + frame.name);
    }
  }
  return out;
}

// The first slice whose pixels are those of the one before it, from 1; 0 if there is none. Empty ones may be alike.
int repeated_slice(const mri::Stack &stack) {
  const std::size_t pixels = stack.pixels() / static_cast<std::size_t>(stack.size[2]);
  for (int k = 1; k < stack.size[2]; ++k) {
    const auto before = std::span(stack.voxels).subspan(stack.offset(0, 0, k - 1), pixels);
    const auto here = std::span(stack.voxels).subspan(stack.offset(0, 0, k), pixels);
    const bool constant = std::all_of(here.begin(), here.end(), [&](float v) { return v == here.front(); });
    if (!constant && std::equal(here.begin(), here.end(), before.begin())) {
      return k + 1;
    }
  }
  return 0;
}

base::Result<const mri::Stack *> load(const std::filesystem::path &file, const Eigen::Vector3d &normal, ScanList &list,
                                      std::vector<std::string> *notes) {
  const auto volume = casefile::read_volume(file, {}, notes);
  if (!volume) {
    return tl::unexpected(volume.error());
  }
  auto stack = slices_of(*volume, normal, list.position, file.string());
  if (!stack) {
    return tl::unexpected(stack.error());
  }
  if (const int k = repeated_slice(*stack); k > 0) {
    return base::failure(file.string() + ": slices " + std::to_string(k - 1) + " and " + std::to_string(k) +
                         " have the same pixels: one was lost, and those behind it lie elsewhere");
  }
  list.files.push_back(file.string());
  return &list.images.emplace_back(std::move(*stack));
}

base::Result<std::vector<Entry>> read_entries(base::TableReader &root, const mri::CoilFrame &frame) {
  std::vector<Entry> out;
  for (base::TableReader &table : root.tables("scans")) {
    Entry entry;
    entry.name = table.string("name", "scan " + std::to_string(out.size() + 1));
    entry.background = table.require_string("background");
    entry.foreground = table.require_string("foreground");
    entry.opposite = table.string("opposite", "");
    entry.background_opposed = table.string("background_opposed", "");
    entry.foreground_opposed = table.string("foreground_opposed", "");
    if (entry.background_opposed.empty() != entry.foreground_opposed.empty()) {
      table.refuse(entry.background_opposed.empty() ? "background_opposed" : "foreground_opposed",
                   "is missing: both images are needed with the read-out reversed");
    } else if (!out.empty() && out.front().foreground_opposed.empty() != entry.foreground_opposed.empty()) {
      table.refuse("foreground_opposed", "either all scans are made with both read-outs, or none");
    }
    entry.orientation = table.require_string("orientation");
    entry.on = coils_named(table, "on", frame);
    entry.verify = coils_named(table, "verify", frame);
    if (entry.on.empty()) {
      table.refuse("on", "names the groups or coils that carried current");
    }
    for (const int coil : entry.verify) {
      if (std::find(entry.on.begin(), entry.on.end(), coil) == entry.on.end()) {
        table.refuse("verify", frame.coils[static_cast<std::size_t>(coil)].name + " is not on in this scan");
      }
    }
    if (const auto normal = mri::parse_orientation(entry.orientation); !normal) {
      table.refuse("orientation", normal.error());
    }
    if (auto ok = table.finish(); !ok) {
      return tl::unexpected(ok.error());
    }
    out.push_back(std::move(entry));
  }
  if (out.empty()) {
    root.refuse("scans", "at least one is needed");
  }
  return out;
}

// The axis along which slices follow, where their distance differs from the side of their square pixels; otherwise -1.
int across_square_pixels(const Eigen::Vector3d &spacing_mm) {
  for (int d = 0; d < 3; ++d) {
    const double a = spacing_mm[(d + 1) % 3], b = spacing_mm[(d + 2) % 3];
    if (std::abs(a - b) < 1e-3 * a && std::abs(spacing_mm[d] - a) > 0.01 * a) {
      return d;
    }
  }
  return -1;
}

} // namespace

base::Result<mri::Stack> slices_of(const mri::Stack &ras, const Eigen::Vector3d &normal_patient,
                                   mri::PatientPosition position, const std::string &what) {
  const Eigen::Matrix4d T_device_image = (mri::T_device_patient(position) * mri::T_image_patient().inverse()).matrix();
  const Eigen::Matrix4d T_device_index = T_device_image * ras.T_image_index;
  const Eigen::Vector3d normal = mri::T_device_patient(position).rotation() * normal_patient;
  int through = -1;
  for (int d = 0; d < 3; ++d) {
    if (std::abs(T_device_index.col(d).head<3>().normalized().dot(normal)) > kAligned) {
      through = d;
    }
  }
  if (through < 0) {
    const Eigen::Vector3d k = mri::T_device_patient(position).rotation().inverse() * T_device_index.col(2).head<3>();
    return base::failure(what + ": its slices are not in the orientation " + mri::print_orientation(normal_patient) +
                         "; those along its third axis are " + mri::print_orientation(k.normalized()));
  }
  if (const int across = across_square_pixels(ras.spacing_mm()); across >= 0 && across != through) {
    const Eigen::Vector3d k =
        mri::T_device_patient(position).rotation().inverse() * T_device_index.col(across).head<3>();
    return base::failure(what + ": its pixels are square in the orientation " + mri::print_orientation(k.normalized()) +
                         ", so its slices are not in the orientation " + mri::print_orientation(normal_patient));
  }
  const std::array<int, 3> order{(through + 1) % 3, (through + 2) % 3, through};
  mri::Stack out;
  for (std::size_t d = 0; d < 3; ++d) {
    out.size[d] = ras.size[static_cast<std::size_t>(order[d])];
    out.T_image_index.col(static_cast<Eigen::Index>(d)) = T_device_index.col(order[d]);
  }
  out.T_image_index.col(3) = T_device_index.col(3);
  out.voxels.resize(ras.voxels.size());
  std::array<int, 3> at{};
  std::size_t n = 0;
  for (at[2] = 0; at[2] < ras.size[2]; ++at[2]) {
    for (at[1] = 0; at[1] < ras.size[1]; ++at[1]) {
      for (at[0] = 0; at[0] < ras.size[0]; ++at[0], ++n) {
        out.voxels[out.offset(at[static_cast<std::size_t>(order[0])], at[static_cast<std::size_t>(order[1])],
                              at[static_cast<std::size_t>(order[2])])] = ras.voxels[n];
      }
    }
  }
  return out;
}

namespace {

struct ListedImage {
  const mri::Stack *image;
  std::string key; // scans[1].foreground
  std::size_t scan;
  bool background;
};

// An image that stands for two would be a coil without current, or a polarity or read-out that was not scanned. Scans
// may have a background in common.
base::Result<void> check_all_differ(const std::filesystem::path &list, const std::vector<ListedImage> &images) {
  for (std::size_t i = 0; i < images.size(); ++i) {
    for (std::size_t j = i + 1; j < images.size(); ++j) {
      const ListedImage &a = images[i], &b = images[j];
      const bool common_background = a.background && b.background && a.scan != b.scan;
      if (!common_background && a.image->voxels == b.image->voxels) {
        return base::failure(list.string() + ": " + a.key + " and " + b.key + " are the same image");
      }
    }
  }
  return {};
}

} // namespace

base::Result<ScanList> read_scan_list(const std::filesystem::path &file, std::vector<std::string> *notes) {
  const auto document = base::TomlDocument::read(file);
  if (!document) {
    return tl::unexpected(document.error());
  }
  base::TableReader root = document->root();
  const std::filesystem::path folder = file.parent_path();
  ScanList out;
  const std::string frame_file = root.require_string("frame");
  if (frame_file.empty()) {
    root.refuse("frame", "is needed: the file of the registration frame");
    return tl::unexpected(root.finish().error());
  }
  auto frame = casefile::read_coil_frame(folder / frame_file);
  if (!frame) {
    return tl::unexpected(frame.error());
  }
  out.frame = std::move(*frame);
  const auto position = mri::parse_patient_position(root.string("patient_position", "HFS"));
  if (!position) {
    root.refuse("patient_position", position.error());
  } else {
    out.position = *position;
  }
  const std::string read_out = root.string("read_out", "");
  const double bandwidth_Hz = root.optional_number("bandwidth_Hz", "Hz", 1.0, 1e5).value_or(0.0);
  const auto entries = read_entries(root, out.frame);
  if (!entries) {
    return tl::unexpected(entries.error());
  }
  if (auto ok = root.finish(); !ok) {
    return tl::unexpected(ok.error());
  }
  std::vector<ListedImage> images;
  for (const Entry &entry : *entries) {
    const Eigen::Vector3d normal = *mri::parse_orientation(entry.orientation);
    mri::CoilScan scan;
    scan.name = entry.name;
    scan.on = entry.on;
    scan.verify = entry.verify;
    struct {
      const char *key;
      const std::string &path;
      const mri::Stack *&to;
    } const listed[] = {{"background", entry.background, scan.background},
                        {"foreground", entry.foreground, scan.foreground},
                        {"opposite", entry.opposite, scan.opposite},
                        {"background_opposed", entry.background_opposed, scan.reversed_background},
                        {"foreground_opposed", entry.foreground_opposed, scan.reversed_foreground}};
    for (const auto &[key, path, to] : listed) {
      if (path.empty()) {
        continue;
      }
      const auto stack = load(folder / path, normal, out, notes);
      if (!stack) {
        return tl::unexpected(stack.error());
      }
      to = *stack;
      images.push_back({to, "scans[" + std::to_string(out.scans.size()) + "]." + key, out.scans.size(),
                        std::string_view(key).starts_with("background")});
    }
    out.scans.push_back(std::move(scan));
  }
  if (auto differ = check_all_differ(file, images); !differ) {
    return tl::unexpected(differ.error());
  }
  if (!read_out.empty()) {
    const Eigen::Matrix4d T_ras_device =
        (mri::T_image_patient() * mri::T_device_patient(out.position).inverse()).matrix();
    std::optional<casefile::ScanHeader> header;
    if (casefile::is_dicom(out.files.front())) {
      if (auto stated = casefile::read_scan_header(out.files.front())) {
        header = std::move(*stated);
      }
    }
    const auto movement = movement_in(T_ras_device * out.images.front().T_image_index, read_out, bandwidth_Hz, header);
    if (!movement) {
      return base::failure(file.string() + ": read_out \"" + read_out + "\", bandwidth_Hz " +
                           std::to_string(bandwidth_Hz) + ": " + movement.error().message);
    }
    out.mm_per_Hz = *movement;
  }
  return out;
}

} // namespace bregma::cli
