#include "casefile/coil_frames.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string_view>
#include <utility>

#include <Eigen/Geometry>

#include "base/table_reader.hpp"
#include "base/text.hpp"

namespace bregma::casefile {

namespace {

constexpr std::string_view kAllOff = "background";
constexpr std::string_view kDirections[] = {"L", "R", "P", "A", "H", "F"};

// Unit vectors of Patient (LPS).
Eigen::Vector3d direction(std::string_view letter) {
  for (int i = 0; i < 6; ++i) {
    if (letter == kDirections[i]) {
      return (i % 2 == 0 ? 1.0 : -1.0) * Eigen::Vector3d::Unit(i / 2);
    }
  }
  return Eigen::Vector3d::Zero();
}

std::string_view letter_of(const Eigen::Vector3d &v) {
  Eigen::Index axis = 0;
  v.cwiseAbs().maxCoeff(&axis);
  return kDirections[2 * axis + (v[axis] < 0.0 ? 1 : 0)];
}

std::optional<Eigen::Matrix3d> read_mount(base::TableReader &root) {
  const bool x = root.has("x_points_to"), z = root.has("z_points_to");
  if (!x && !z) {
    return std::nullopt;
  }
  if (x != z) {
    root.refuse(x ? "x_points_to" : "z_points_to", "x_points_to and z_points_to belong together");
  }
  const std::vector<std::string> choices(std::begin(kDirections), std::end(kDirections));
  const Eigen::Vector3d along_x = direction(root.choice("x_points_to", "L", choices));
  const Eigen::Vector3d along_z = direction(root.choice("z_points_to", "H", choices));
  if (std::abs(along_x.dot(along_z)) > 0.5) {
    root.refuse("z_points_to", "must be perpendicular to x_points_to");
  }
  Eigen::Matrix3d out;
  out << along_x, along_z.cross(along_x), along_z;
  return out;
}

// Why no pattern of a controller and no list of scans could name it; empty if one can.
std::string word_problem(const std::string &word) {
  if (word == kAllOff) {
    return "stands for all coils off";
  }
  const bool plain = std::none_of(word.begin(), word.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 || c == '+' || c == '"' || c == '\\';
  });
  return word.empty() || word != base::trimmed(word) || !plain
             ? "must be a word without + \" \\ and without blanks at its ends"
             : std::string();
}

} // namespace

base::Result<mri::CoilFrame> read_coil_frame(const std::filesystem::path &file) {
  const auto document = base::TomlDocument::read(file);
  if (!document) {
    return tl::unexpected(document.error());
  }
  base::TableReader root = document->root();
  mri::CoilFrame out;
  out.name = root.require_string("name");
  out.build_sigma_mm = root.number("build_sigma_mm", out.build_sigma_mm, "mm", 0.001, 10.0);
  out.R_patient_base = read_mount(root);
  for (base::TableReader &table : root.tables("coils")) {
    mri::FrameCoil coil;
    coil.name = table.require_string("name");
    coil.group = table.string("group", coil.name);
    coil.position_mm = table.require_vector3("position_mm");
    for (const auto &[key, word] : {std::pair("name", coil.name), std::pair("group", coil.group)}) {
      if (const std::string problem = word_problem(word); !problem.empty()) {
        table.refuse(key, problem);
      }
    }
    if (out.find(coil.name) >= 0) {
      table.refuse("name", "appears twice");
    }
    for (const mri::FrameCoil &other : out.coils) {
      if (other.group == coil.name) {
        table.refuse("name", "is the group of " + other.name + ": a pattern that names it would mean both");
      } else if (other.name == coil.group) {
        table.refuse("group", "is the coil " + other.name + " as well: a pattern that names it would mean both");
      }
    }
    for (const mri::FrameCoil &other : out.coils) {
      if ((other.position_mm - coil.position_mm).norm() < 1.0) {
        table.refuse("position_mm", "is the place of " + other.name);
      }
    }
    if (auto ok = table.finish(); !ok) {
      return tl::unexpected(ok.error());
    }
    out.coils.push_back(std::move(coil));
  }
  if (out.coils.size() < 4) {
    root.refuse("coils", "at least four are needed");
  }
  if (auto ok = root.finish(); !ok) {
    return tl::unexpected(ok.error());
  }
  return out;
}

std::string coil_frame_text(const mri::CoilFrame &frame) {
  const auto number = [](double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.17g", value);
    return std::string(text);
  };
  std::string out = "name = \"" + frame.name + "\"\nbuild_sigma_mm = " + number(frame.build_sigma_mm) + "\n";
  if (frame.R_patient_base) {
    out += "x_points_to = \"" + std::string(letter_of(frame.R_patient_base->col(0))) + "\"\nz_points_to = \"" +
           std::string(letter_of(frame.R_patient_base->col(2))) + "\"\n";
  }
  for (const mri::FrameCoil &coil : frame.coils) {
    out += "\n[[coils]]\nname = \"" + coil.name + "\"\ngroup = \"" + coil.group + "\"\nposition_mm = [" +
           number(coil.position_mm.x()) + ", " + number(coil.position_mm.y()) + ", " + number(coil.position_mm.z()) +
           "]\n";
  }
  return out;
}

tl::expected<std::uint64_t, std::string> coils_of(const mri::CoilFrame &frame, const std::string &pattern) {
  std::uint64_t out = 0;
  if (pattern == kAllOff) {
    return out;
  }
  for (const std::string_view word : base::cells(pattern, '+')) {
    std::uint64_t coils = 0;
    for (std::size_t i = 0; i < frame.coils.size(); ++i) {
      if (frame.coils[i].group == word || frame.coils[i].name == word) {
        coils |= std::uint64_t{1} << i;
      }
    }
    if (coils == 0) {
      return tl::make_unexpected("\"" + std::string(word) + "\" is no coil and no group of the frame " + frame.name);
    }
    out |= coils;
  }
  return out;
}

} // namespace bregma::casefile
