#include "casefile/volumes/displacement_file.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <map>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <Eigen/LU>

#include "base/write_file.hpp"
#include "casefile/sha256.hpp"
#include "casefile/space.hpp"
#include "casefile/volumes/image_header.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

static_assert(std::endian::native == std::endian::little, "NRRD data are written as they are in memory");

constexpr std::int64_t kMaxNodes = 64'000'000;

std::string problem(const fs::path &path, const std::string &what) { return path.string() + ": " + what; }

std::string number(double value) {
  std::array<char, 32> text{};
  const auto [end, status] = std::to_chars(text.data(), text.data() + text.size(), value);
  return status == std::errc() ? std::string(text.data(), end) : "0";
}

std::string vector(const Eigen::Vector3d &v) {
  return "(" + number(v.x()) + "," + number(v.y()) + "," + number(v.z()) + ")";
}

bool is_one_line(std::string_view text) {
  return std::none_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; });
}

// components: 3 or 1. values: components per voxel.
std::string nrrd_text(const image::Grid<3> &grid, int components, const std::vector<float> &values,
                      const std::map<std::string, std::string> &keys) {
  const bool vectors = components == 3;
  const Eigen::Matrix3d axes = grid.axes();
  std::string out = std::string("NRRD0005\n# made by bregma\ntype: float\ndimension: ") + (vectors ? "4" : "3") +
                    "\nspace: left-posterior-superior\nsizes:" + (vectors ? " 3" : "");
  for (const int size : grid.size) {
    out += " " + std::to_string(size);
  }
  out += std::string("\nspace directions:") + (vectors ? " none" : "");
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    out += " " + vector(flipped(axes.col(axis)));
  }
  out += std::string("\nkinds:") + (vectors ? " vector" : "") +
         " domain domain domain\nendian: little\nencoding: raw\nspace origin: " + vector(flipped(grid.origin_mm())) +
         "\n";
  for (const auto &[key, value] : keys) {
    out += "bregma " + key + ":=" + value + "\n";
  }
  out += "\n";
  return out.append(reinterpret_cast<const char *>(values.data()), values.size() * sizeof(float));
}

// Of the displacements as in the file: which field the errors beside it are of.
std::string mark_of(const std::vector<float> &values) { return to_hex(sha256(std::as_bytes(std::span(values)))); }

std::vector<float> values_of(const DisplacementField &field) {
  std::vector<float> out;
  out.reserve(3 * field.displacement_mm.voxels.size());
  for (const Eigen::Vector3f &v : field.displacement_mm.voxels) {
    out.insert(out.end(), {-v.x(), -v.y(), v.z()}); // LPS
  }
  return out;
}

struct DisplacementNrrd {
  image::Grid<3> grid; // RAS
  std::vector<float> values;
  std::map<std::string, std::string> keys;
};

class NrrdReader {
public:
  NrrdReader(fs::path path, int components) : path_(std::move(path)), components_(components) {}

  base::Result<DisplacementNrrd> read() {
    std::error_code ignored;
    if (!fs::is_regular_file(path_, ignored)) {
      return base::failure(problem(path_, fs::exists(path_, ignored) ? "is not a file" : "no such file"));
    }
    if (!read_file_head(path_, 4).bytes.starts_with("NRRD")) {
      return base::failure(problem(path_, "is not an NRRD file"));
    }
    const auto header = read_text_header(path_, [](std::string_view line) { return line.empty(); });
    if (!header) {
      return tl::unexpected(header.error());
    }
    if (header->lines.empty() || !header->lines.front().starts_with("NRRD000")) {
      return base::failure(problem(path_, "is not an NRRD file"));
    }
    for (const std::string &line : header->lines) {
      if (const auto at = line.find(":="); at != std::string::npos) {
        if (line.starts_with("bregma ")) {
          out_.keys[line.substr(7, at - 7)] = line.substr(at + 2);
        }
      } else if (const auto colon = line.find(": "); colon != std::string::npos && line.front() != '#') {
        fields_[line.substr(0, colon)] = line.substr(colon + 2);
      }
    }
    return check_fields().and_then([&] { return read_values(header->bytes); }).map([&] { return std::move(out_); });
  }

private:
  base::Result<void> refuse(const std::string &field, const std::string &what) {
    return base::failure(problem(path_, field + " \"" + fields_[field] + "\" " + what));
  }

  base::Result<void> check_fields() {
    const bool vectors = components_ == 3;
    const std::map<std::string, std::string> expected = {
        {"type", "float"},    {"dimension", vectors ? "4" : "3"},
        {"endian", "little"}, {"space", "left-posterior-superior"},
        {"encoding", "raw"},  {"kinds", vectors ? "vector domain domain domain" : "domain domain domain"}};
    for (const auto &[field, value] : expected) {
      if (fields_[field] != value) {
        return refuse(field, "is not that of a distortion field as `bregma mri field` writes it: " + value);
      }
    }
    std::vector<double> sizes = header_numbers(fields_["sizes"]);
    if (vectors && !sizes.empty() && sizes.front() == 3.0) {
      sizes.erase(sizes.begin());
    }
    std::int64_t nodes = 1;
    for (const double size : sizes) {
      if (!(size >= 1.0 && size <= 1e6 && size == std::floor(size))) {
        return refuse("sizes", "must be whole numbers of at least one");
      }
      nodes = nodes > kMaxNodes ? nodes : nodes * static_cast<std::int64_t>(size);
    }
    if (sizes.size() != 3 || nodes > kMaxNodes) {
      return refuse("sizes", "must be those of three axes with at most " + std::to_string(kMaxNodes) + " nodes");
    }
    std::string directions = fields_["space directions"];
    if (vectors && directions.starts_with("none ")) {
      directions.erase(0, 5);
    }
    std::replace_if(
        directions.begin(), directions.end(), [](char c) { return c == '(' || c == ')'; }, ' ');
    const std::vector<double> axes = header_numbers(directions);
    const std::vector<double> origin = header_numbers(fields_["space origin"]);
    if (axes.size() != 9 || origin.size() != 3) {
      return refuse(axes.size() != 9 ? "space directions" : "space origin", "must have three numbers per vector");
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      out_.grid.size[axis] = static_cast<int>(sizes[axis]);
      out_.grid.T_image_index.col(static_cast<Eigen::Index>(axis)).head<3>() =
          flipped(Eigen::Vector3d(axes.data() + 3 * axis));
    }
    out_.grid.T_image_index.topRightCorner<3, 1>() = flipped(Eigen::Vector3d(origin.data()));
    const double volume = std::abs(out_.grid.axes().determinant());
    if (!out_.grid.T_image_index.allFinite() || !(volume > 1e-9 && volume < 1e9)) {
      return refuse("space directions", "do not span a grid");
    }
    return {};
  }

  base::Result<void> read_values(std::uint64_t header_bytes) {
    const std::size_t count = out_.grid.pixels() * static_cast<std::size_t>(components_);
    std::error_code ignored;
    const std::uint64_t file_bytes = fs::file_size(path_, ignored);
    if (file_bytes != header_bytes + count * sizeof(float)) {
      return base::failure(problem(path_, "has " + std::to_string(file_bytes) + " bytes, its header asks for " +
                                              std::to_string(header_bytes + count * sizeof(float))));
    }
    out_.values.resize(count);
    std::ifstream in(path_, std::ios::binary);
    in.seekg(static_cast<std::streamoff>(header_bytes));
    in.read(reinterpret_cast<char *>(out_.values.data()), static_cast<std::streamsize>(count * sizeof(float)));
    if (!in) {
      return base::failure(problem(path_, "cannot be read"));
    }
    const auto broken =
        std::count_if(out_.values.begin(), out_.values.end(), [](float v) { return !std::isfinite(v); });
    return broken == 0 ? base::Result<void>()
                       : base::failure(problem(path_, std::to_string(broken) + " values are not finite"));
  }

  fs::path path_;
  int components_;
  std::map<std::string, std::string> fields_;
  DisplacementNrrd out_;
};

constexpr std::array kParts = {"", "gradients", "B0"}; // in the order of FieldPart

// "(x,y,z)" in LPS; nothing for another text.
std::optional<Eigen::Vector3d> vector_of(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '(' || c == ')' || c == ','; }, ' ');
  const std::vector<double> numbers = header_numbers(text);
  if (numbers.size() != 3) {
    return std::nullopt;
  }
  const Eigen::Vector3d out = flipped(Eigen::Vector3d(numbers.data()));
  return out.allFinite() ? std::optional(out) : std::nullopt;
}

bool is_date(const std::string &text) {
  constexpr std::string_view kForm = "dddd-dd-dd";
  return text.size() == kForm.size() && std::equal(text.begin(), text.end(), kForm.begin(), [](char c, char form) {
           return form == 'd' ? c >= '0' && c <= '9' : c == form;
         });
}

} // namespace

std::string field_mark(const DisplacementField &field) { return mark_of(values_of(field)); }

fs::path error_file_of(const fs::path &path) {
  fs::path out = path;
  return out.replace_extension(".error.nrrd");
}

base::Result<void> write_displacement_field(const fs::path &path, const DisplacementField &field) {
  if (path.extension() != ".nrrd") {
    return base::failure(problem(path, "a distortion field is written as .nrrd"));
  }
  const std::map<std::string, std::string> keys = {{"max_error_95_mm", number(field.max_error_95_mm)},
                                                   {"scanner", field.scanner},
                                                   {"protocol", field.protocol},
                                                   {"patient_position", field.patient_position},
                                                   {"made", field.made},
                                                   {"expires", field.expires},
                                                   {"part", kParts.at(static_cast<std::size_t>(field.part))},
                                                   {"mm_per_Hz", vector(flipped(field.mm_per_Hz))},
                                                   {"gradients", field.gradients}};
  for (const auto &[key, value] : keys) {
    if (!is_one_line(value)) {
      return base::failure(problem(path, key + " has a line break or a control character"));
    }
  }
  const std::vector<float> values = values_of(field);
  const std::string displacements = nrrd_text(field.displacement_mm, 3, values, keys);
  if (field.signed_error_95_mm.voxels.empty()) {
    return base::write_file(path, displacements).map([&] {
      std::error_code ignored;
      fs::remove(error_file_of(path), ignored); // of another field
    });
  }
  const std::string errors = nrrd_text(field.signed_error_95_mm, 1, field.signed_error_95_mm.voxels,
                                       {{"content", "error not exceeded with 95 %, mm; negative where the field "
                                                    "extrapolates"},
                                        {"field", mark_of(values)}});
  // Each is whole or as it was; what is left of two fields, where only one was written, does not agree.
  return base::write_file(error_file_of(path), errors).and_then([&] { return base::write_file(path, displacements); });
}

base::Result<DisplacementField> read_displacement_field(const fs::path &path) {
  auto vectors = NrrdReader(path, 3).read();
  if (!vectors) {
    return tl::unexpected(vectors.error());
  }
  auto errors = NrrdReader(error_file_of(path), 1).read();
  if (!errors) {
    return tl::unexpected(errors.error());
  }
  if (const std::string &mark = errors->keys["field"]; !mark.empty() && mark != mark_of(vectors->values)) {
    return base::failure(problem(error_file_of(path), "holds the errors of another field than " + path.string() +
                                                          ": copy both files, or make the field again"));
  }
  DisplacementField out;
  out.scanner = vectors->keys["scanner"];
  out.protocol = vectors->keys["protocol"];
  out.patient_position = vectors->keys["patient_position"];
  out.made = vectors->keys["made"];
  out.expires = vectors->keys["expires"];
  const std::string &limit = vectors->keys["max_error_95_mm"];
  const auto [end, status] = std::from_chars(limit.data(), limit.data() + limit.size(), out.max_error_95_mm);
  if (status != std::errc() || end != limit.data() + limit.size() || !(out.max_error_95_mm > 0.0) ||
      !std::isfinite(out.max_error_95_mm)) {
    return base::failure(problem(path, "bregma max_error_95_mm \"" + limit + "\" is not a positive number"));
  }
  if (!is_date(out.made) || (!out.expires.empty() && !is_date(out.expires))) {
    return base::failure(problem(path, "bregma made \"" + out.made + "\" or expires \"" + out.expires +
                                           "\" is not a date (YYYY-MM-DD)"));
  }
  out.gradients = vectors->keys["gradients"];
  const std::string &part = vectors->keys["part"]; // files of earlier versions have none
  const auto *const known = std::find(kParts.begin(), kParts.end(), part);
  if (known == kParts.end()) {
    return base::failure(problem(path, "bregma part \"" + part + "\" is not gradients or B0"));
  }
  out.part = static_cast<FieldPart>(known - kParts.begin());
  if (const std::string &text = vectors->keys["mm_per_Hz"]; !text.empty()) {
    const auto movement = vector_of(text);
    if (!movement) {
      return base::failure(problem(path, "bregma mm_per_Hz \"" + text + "\" is not three numbers"));
    }
    out.mm_per_Hz = *movement;
  }
  static_cast<image::Grid<3> &>(out.displacement_mm) = vectors->grid;
  const std::vector<float> &v = vectors->values;
  out.displacement_mm.voxels.reserve(v.size() / 3);
  for (std::size_t i = 0; i + 2 < v.size(); i += 3) {
    out.displacement_mm.voxels.emplace_back(-v[i], -v[i + 1], v[i + 2]);
  }
  static_cast<image::Grid<3> &>(out.signed_error_95_mm) = errors->grid;
  out.signed_error_95_mm.voxels = std::move(errors->values);
  return out;
}

} // namespace bregma::casefile
