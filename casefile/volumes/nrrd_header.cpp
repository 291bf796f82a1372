// The header of an NRRD file: teem.sourceforge.net/nrrd/format.html, sections 2 to 6.
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <numeric>
#include <system_error>
#include <utility>

#include "base/text.hpp"
#include "casefile/length_unit.hpp"
#include "casefile/volumes/image_header.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;
using Fields = std::map<std::string, std::string, std::less<>>; // names in lower case

struct NrrdSpace {
  std::string_view name, letters;
  Eigen::Vector3d signs; // of RAS
};

const std::array<NrrdSpace, 3> kSpaces{{{"right-anterior-superior", "ras", {1, 1, 1}},
                                        {"left-anterior-superior", "las", {-1, 1, 1}},
                                        {"left-posterior-superior", "lps", {-1, -1, 1}}}};
// Right-handed frames that say nothing about the patient.
constexpr std::array<std::string_view, 3> kOpenSpaces{"scanner-xyz", "3d-right-handed", "xyz"};

std::string problem(const fs::path &path, std::string_view field, std::string_view value, const std::string &what) {
  return path.string() + ": " + std::string(field) + " = \"" + std::string(value.substr(0, 80)) + "\": " + what;
}

std::string value_of(const Fields &fields, std::string_view name) {
  const auto found = fields.find(name);
  return found != fields.end() ? found->second : "";
}

// Some fields have two names.
std::string field_name(std::string name) {
  for (const auto &[other, usual] : {std::pair("datafile", "data file"),
                                     {"lineskip", "line skip"},
                                     {"byteskip", "byte skip"},
                                     {"axismins", "axis mins"}}) {
    name = name == other ? usual : name;
  }
  return name;
}

// Bytes of a value; 0: an unknown type.
std::uint64_t bytes_of_type(const std::string &type) {
  std::string plain = type;
  for (const std::string_view word : {"signed ", "unsigned "}) {
    if (plain.starts_with(word)) {
      plain.erase(0, word.size());
    }
  }
  if (plain.starts_with("u") && !plain.starts_with("unsigned")) {
    plain.erase(0, 1);
  }
  if (plain.ends_with(" int") && plain != "int") {
    plain.erase(plain.size() - 4);
  }
  static const std::map<std::string, std::uint64_t, std::less<>> kBytes{
      {"char", 1},      {"int8", 1},  {"int8_t", 1},  {"short", 2},   {"int16", 2},
      {"int16_t", 2},   {"int", 4},   {"int32", 4},   {"int32_t", 4}, {"longlong", 8},
      {"long long", 8}, {"int64", 8}, {"int64_t", 8}, {"float", 4},   {"double", 8}};
  const auto known = kBytes.find(plain);
  return known != kBytes.end() ? known->second : 0;
}

// Words between blanks, of which each may be in quotes.
std::vector<std::string> words_of(const std::string &text) {
  std::vector<std::string> out;
  for (std::size_t at = text.find_first_not_of(" \t"); at < text.size(); at = text.find_first_not_of(" \t", at)) {
    const bool quoted = text[at] == '"';
    const std::size_t begin = at + (quoted ? 1 : 0);
    const std::size_t end = std::min(quoted ? text.find('"', begin) : text.find_first_of(" \t", begin), text.size());
    out.push_back(text.substr(begin, end - begin));
    at = std::min(end + (quoted ? 1 : 0), text.size());
  }
  return out;
}

// "(a,b,c) none (d,e,f)": a column per axis; an axis without one is not in space.
std::vector<std::optional<Eigen::Vector3d>> directions_of(const std::string &text) {
  std::vector<std::optional<Eigen::Vector3d>> out;
  for (std::size_t at = text.find_first_not_of(" \t"); at != std::string::npos;
       at = text.find_first_not_of(" \t", at)) {
    const bool vector = text[at] == '(';
    const std::size_t end = vector ? text.find(')', at) : std::min(text.find_first_of(" \t", at), text.size());
    if (end == std::string::npos) {
      return {};
    }
    const std::vector<double> numbers = header_numbers(std::string_view(text).substr(at, end - at));
    if (vector && numbers.size() != 3) {
      return {};
    }
    out.push_back(vector ? std::optional(Eigen::Vector3d(numbers.data())) : std::nullopt);
    at = end + (vector ? 1 : 0);
  }
  return out;
}

class Nrrd {
public:
  Nrrd(fs::path path, Fields fields, std::uint64_t header_bytes)
      : path_(std::move(path)), fields_(std::move(fields)), header_bytes_(header_bytes) {}

  base::Result<ImageHeader> read(std::optional<Space> space) {
    return read_size()
        .and_then([&] { return read_axes(); })
        .and_then([&] { return place(space); })
        .and_then([&] { return check_data(); })
        .map([&] { return out_; });
  }

private:
  base::Result<void> refuse(std::string_view field, const std::string &what) const {
    return base::failure(problem(path_, field, value_of(fields_, field), what));
  }

  base::Result<void> read_size() {
    const std::vector<double> sizes = header_numbers(value_of(fields_, "sizes"));
    if (sizes.empty()) {
      return refuse("sizes", "must be whole numbers, one per axis");
    }
    const auto shape = check_shape(path_, sizes);
    if (!shape) {
      return tl::unexpected(shape.error());
    }
    out_.size = *shape;
    sizes_ = sizes;
    return {};
  }

  // The columns of the three axes in space, in the file's frame, and its unit.
  base::Result<void> read_axes() {
    const std::string stated = value_of(fields_, "space directions");
    std::vector<std::optional<Eigen::Vector3d>> axes = directions_of(stated);
    if (!stated.empty() && !fields_.contains("space") && !fields_.contains("space dimension")) {
      return refuse("space directions", "are in no space: space, or space dimension, is not stated");
    }
    for (const char *other : {"spacings", "units"}) {
      if (!stated.empty() && fields_.contains(other)) {
        return refuse(other, "is stated beside space directions, which have spacings and units of their own");
      }
    }
    if (stated.empty()) {
      const std::vector<double> spacings = header_numbers(value_of(fields_, "spacings"));
      if (spacings.size() < 3) {
        return base::failure(path_.string() + ": states neither space directions nor spacings of three axes");
      }
      for (Eigen::Index axis = 0; axis < 3; ++axis) {
        axes.emplace_back(spacings[static_cast<std::size_t>(axis)] * Eigen::Vector3d::Unit(axis));
      }
      out_.notes.push_back(path_.string() + ": the directions of its axes are not stated: they are assumed to be those "
                                            "of the space");
    }
    const auto in_space = std::count_if(axes.begin(), axes.end(), [](const auto &axis) { return axis.has_value(); });
    if (in_space != 3 || axes.size() < 3 || !axes[0] || !axes[1] || !axes[2]) {
      return refuse("space directions", "the first three axes must be those in space");
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      axes_.col(static_cast<Eigen::Index>(axis)) = *axes[axis];
    }
    return read_unit();
  }

  // "space units" of the space, or "units" of the axes, where they have spacings.
  base::Result<void> read_unit() {
    const std::string_view field = fields_.contains("space units")        ? "space units"
                                   : fields_.contains("space directions") ? ""
                                                                          : "units";
    const std::vector<std::string> units = words_of(value_of(fields_, field));
    std::optional<LengthUnit> known;
    for (std::size_t axis = 0; axis < std::min<std::size_t>(units.size(), 3); ++axis) {
      if (units[axis].empty() || units[axis] == "???" || base::lower(units[axis]) == "none") {
        continue; // not stated
      }
      const auto unit = unit_named(units[axis]);
      if (!unit || (known && *known != *unit)) {
        return refuse(field, "must be one of mm, cm, m and um, the same for all axes");
      }
      known = unit;
    }
    scale_ = known ? mm_per(*known) : 1.0;
    return {};
  }

  // Places of axes without a space are stated by "axis mins", which few programs write or read.
  base::Result<void> check_axis_mins() const {
    const std::vector<double> mins = header_numbers(value_of(fields_, "axis mins"));
    if (std::any_of(mins.begin(), mins.end(), [](double min) { return std::isfinite(min) && min != 0.0; }) &&
        !fields_.contains("space origin")) {
      return refuse("axis mins", "is not read; state the place of the first voxel as space origin");
    }
    return {};
  }

  base::Result<void> place(std::optional<Space> space) {
    const std::string stated = base::lower(value_of(fields_, "space"));
    const auto known = std::find_if(kSpaces.begin(), kSpaces.end(), [&stated](const NrrdSpace &one) {
      return stated == one.name || stated == one.letters;
    });
    const bool open = stated.empty() || std::find(kOpenSpaces.begin(), kOpenSpaces.end(), stated) != kOpenSpaces.end();
    if (stated.ends_with("-time") || stated == "rast" || stated == "last" || stated == "lpst") {
      return refuse("space", "has a time: an image of four dimensions is not read");
    }
    if (known == kSpaces.end() && !open) {
      return refuse("space", "is not a frame of a patient that is read: right-anterior-superior (RAS), "
                             "left-anterior-superior (LAS), left-posterior-superior (LPS)");
    }
    if (auto mins = check_axis_mins(); !mins) {
      return mins;
    }
    Eigen::Vector3d signs(-1, -1, 1);
    if (known != kSpaces.end()) {
      signs = known->signs;
    } else if (out_.space_stated = false; space) {
      signs = *space == Space::kRas ? Eigen::Vector3d(1, 1, 1) : signs;
    } else {
      out_.notes.push_back(path_.string() +
                           (stated.empty() ? ": its space is not stated"
                                           : ": its space, \"" + stated + "\", does not state the patient's sides") +
                           ": LPS is assumed");
    }
    const std::vector<double> origin = header_numbers(value_of(fields_, "space origin"));
    if (origin.size() != 3 && fields_.contains("space origin")) {
      return refuse("space origin", "must be three numbers");
    }
    if (origin.empty()) {
      out_.notes.push_back(path_.string() + ": its origin is not stated: 0 is assumed");
    }
    const Eigen::Vector3d at = origin.empty() ? Eigen::Vector3d::Zero() : Eigen::Vector3d(origin.data());
    out_.T_ras_index.topLeftCorner<3, 3>() = scale_ * signs.asDiagonal() * axes_;
    out_.T_ras_index.topRightCorner<3, 1>() = scale_ * signs.cwiseProduct(at);
    return {};
  }

  base::Result<void> check_data() {
    const std::uint64_t each = bytes_of_type(base::lower(value_of(fields_, "type")));
    if (each == 0) {
      return refuse("type", "is not a type of numbers that is read");
    }
    const double values = std::accumulate(sizes_.begin(), sizes_.end(), 1.0, std::multiplies<>());
    StoredData data{path_, header_bytes_, false};
    if (const std::string detached = value_of(fields_, "data file"); !detached.empty()) {
      if (detached.starts_with("LIST") || detached.find('%') != std::string::npos) {
        return refuse("data file", "several data files are not read");
      }
      data = {path_.parent_path() / detached, 0, false};
    }
    if (auto skipped = skip_lines(data); !skipped) {
      return skipped;
    }
    const std::string encoding = base::lower(value_of(fields_, "encoding"));
    if (encoding == "gzip" || encoding == "gz") {
      data.compressed = true;
    } else if (encoding == "ascii" || encoding == "text" || encoding == "txt") {
      return check_text(data, values);
    } else if (encoding != "raw") {
      return refuse("encoding", "is not read; read are raw, gzip and ascii");
    }
    const auto needed = static_cast<std::uint64_t>(values) * each;
    return skip_bytes(data, needed).and_then([&] { return check_whole(data, needed, path_, out_); });
  }

  // The number of a field, 0 without it; at least `least`.
  base::Result<std::int64_t> count_of(std::string_view name, double least) const {
    const std::string stated = value_of(fields_, name);
    const std::vector<double> numbers = header_numbers(stated);
    if (stated.empty()) {
      return 0;
    }
    if (numbers.size() != 1 || !(numbers[0] >= least && numbers[0] < 1e12) || numbers[0] != std::floor(numbers[0])) {
      return tl::unexpected(refuse(name, "must be a whole number from " + std::to_string(int(least)) + " on").error());
    }
    return static_cast<std::int64_t>(numbers[0]);
  }

  // Lines before the data, which are not compressed.
  base::Result<void> skip_lines(StoredData &data) const {
    const auto lines = count_of("line skip", 0);
    if (!lines) {
      return tl::unexpected(lines.error());
    }
    std::ifstream in(data.file, std::ios::binary);
    in.seekg(static_cast<std::streamoff>(data.begin));
    for (std::int64_t line = 0; line < *lines; ++line) {
      in.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
      data.begin += static_cast<std::uint64_t>(in.gcount());
      if (!in || in.eof()) {
        return refuse("line skip", "the file has " + std::to_string(line) + " lines before its data");
      }
    }
    return {};
  }

  // Bytes before the voxels, after inflating where they are compressed; -1: the voxels are at the end of the file.
  base::Result<void> skip_bytes(StoredData &data, std::uint64_t needed) {
    const auto bytes = count_of("byte skip", data.compressed ? 0 : -1);
    if (!bytes) {
      return tl::unexpected(bytes.error());
    }
    if (*bytes >= 0) {
      data.skipped = static_cast<std::uint64_t>(*bytes);
      return {};
    }
    std::error_code error;
    const std::uintmax_t size = fs::file_size(data.file, error);
    if (!error && size >= needed + data.begin) {
      data.begin = size - needed;
    }
    out_.notes.push_back(data.file.string() +
                         ": its voxels are counted from its end: whether it is whole is not known");
    return {};
  }

  base::Result<void> check_text(const StoredData &data, double values) {
    std::ifstream in(data.file, std::ios::binary);
    in.seekg(static_cast<std::streamoff>(data.begin));
    std::uint64_t found = 0;
    bool ends = true; // with a blank, or the last number may lack digits
    for (std::string word; in >> word; ++found) {
      if (!base::parsed_number<double>(word)) {
        return base::failure(data.file.string() + ": \"" + word.substr(0, 40) + "\" among its voxels is no number");
      }
      ends = !in.eof();
    }
    if (static_cast<double>(found) != values) {
      return base::failure(data.file.string() + (static_cast<double>(found) < values ? ": is not whole: it" : ":") +
                           " holds " + std::to_string(found) + " numbers, its header asks for " +
                           std::to_string(static_cast<std::uint64_t>(values)));
    }
    if (!ends) {
      out_.notes.push_back(data.file.string() +
                           ": the last line does not end: digits of its last number may be missing");
    }
    return {};
  }

  fs::path path_;
  Fields fields_;
  std::uint64_t header_bytes_;
  std::vector<double> sizes_;
  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();
  double scale_ = 1.0; // mm per unit
  ImageHeader out_;
};

} // namespace

base::Result<ImageHeader> read_nrrd_header(const fs::path &path, std::optional<Space> space) {
  // A detached header ends with the file.
  auto header = read_text_header(path, [](std::string_view line) { return line.empty(); });
  if (!header && base::lower(path.extension().string()) == ".nhdr") {
    std::ifstream in(path);
    header = TextHeader{};
    for (std::string line; std::getline(in, line);) {
      header->lines.emplace_back(base::trimmed(line));
    }
  }
  if (!header) {
    return tl::unexpected(header.error());
  }
  Fields fields;
  for (const std::string &line : header->lines) {
    const std::size_t colon = line.find(':');
    // "key:=value" is a note of the file.
    if (line.starts_with('#') || colon == std::string::npos || line.compare(colon, 2, ":=") == 0) {
      continue;
    }
    const std::string name = field_name(base::lower(base::trimmed(line.substr(0, colon))));
    const std::string value(base::trimmed(line.substr(colon + 1)));
    if (const auto [field, fresh] = fields.emplace(name, value); !fresh && field->second != value) {
      return base::failure(problem(path, name, value, "is stated before as \"" + field->second + "\""));
    }
  }
  return Nrrd(path, std::move(fields), header->bytes).read(space);
}

} // namespace bregma::casefile
