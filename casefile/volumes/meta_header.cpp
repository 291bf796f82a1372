// The header of a MetaImage file: itk.org/Wiki/MetaIO/Documentation, "Reference: Tags of MetaImage".
#include <algorithm>
#include <cmath>
#include <map>
#include <system_error>
#include <utility>

#include "base/text.hpp"
#include "casefile/length_unit.hpp"
#include "casefile/volumes/image_header.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;
using Tags = std::map<std::string, std::string, std::less<>>;

std::string first_of(const Tags &tags, std::initializer_list<std::string_view> names) {
  for (const std::string_view name : names) {
    if (const auto found = tags.find(name); found != tags.end()) {
      return found->second;
    }
  }
  return "";
}

base::Result<void> refuse_tag(const fs::path &path, const std::string &tag, const std::string &value,
                              const std::string &what) {
  return base::failure(path.string() + ": " + tag + " = \"" + value.substr(0, 80) + "\": " + what);
}

// Some tags have several names.
std::string tag_name(std::string name) {
  for (const auto &[other, usual] : {std::pair("Position", "Offset"),
                                     {"Origin", "Offset"},
                                     {"Rotation", "TransformMatrix"},
                                     {"Orientation", "TransformMatrix"},
                                     {"ElementByteOrderMSB", "BinaryDataByteOrderMSB"}}) {
    name = name == other ? usual : name;
  }
  return name;
}

bool is_true(const std::string &value) {
  return !value.empty() && (value[0] == 'T' || value[0] == 't' || value[0] == '1');
}

std::uint64_t bytes_of_element(const std::string &type) {
  static const std::map<std::string, std::uint64_t, std::less<>> kBytes{
      {"MET_CHAR", 1},      {"MET_UCHAR", 1},      {"MET_SHORT", 2}, {"MET_USHORT", 2},
      {"MET_INT", 4},       {"MET_UINT", 4},       {"MET_LONG", 4},  {"MET_ULONG", 4},
      {"MET_LONG_LONG", 8}, {"MET_ULONG_LONG", 8}, {"MET_FLOAT", 4}, {"MET_DOUBLE", 8}};
  const auto known = kBytes.find(type);
  return known != kBytes.end() ? known->second : 0;
}

base::Result<void> read_meta_size(const fs::path &path, const Tags &tags, ImageHeader &out) {
  const std::string stated = first_of(tags, {"DimSize"});
  const std::vector<double> sizes = header_numbers(stated);
  const std::vector<double> dimensions = header_numbers(first_of(tags, {"NDims"}));
  if (sizes.empty() || (dimensions.size() == 1 && dimensions[0] != static_cast<double>(sizes.size()))) {
    return refuse_tag(path, "DimSize", stated, "must be whole numbers, one per axis");
  }
  if (sizes.size() != 3) {
    return refuse_tag(path, "NDims", std::to_string(sizes.size()), "a volume has three dimensions");
  }
  return check_shape(path, sizes).map([&out](const auto &shape) { out.size = shape; });
}

// mm per unit of ElementSpacing and Offset; mm where nothing is stated, as MetaIO defines it.
base::Result<double> unit_of_meta(const fs::path &path, const Tags &tags, ImageHeader &out) {
  const std::string stated = base::lower(first_of(tags, {"DistanceUnits"}));
  if (stated.empty() || stated == "?" || stated == "mm") {
    return 1.0;
  }
  const auto unit = unit_named(stated);
  if (!unit) {
    return tl::unexpected(refuse_tag(path, "DistanceUnits", stated, "must be mm, cm, m or um").error());
  }
  out.notes.push_back(path.string() + ": DistanceUnits = " + stated +
                      ": its spacing and offset are converted to mm; programs of ITK take them as mm");
  return mm_per(*unit);
}

// The rows of TransformMatrix are the directions of the axes; LPS, as ITK writes it.
base::Result<void> place_meta(const fs::path &path, const Tags &tags, std::optional<Space> space, ImageHeader &out) {
  const std::string matrix_text = first_of(tags, {"TransformMatrix"});
  const std::string offset_text = first_of(tags, {"Offset"});
  const std::string spacing_text = first_of(tags, {"ElementSpacing", "ElementSize"});
  const std::string centre_text = first_of(tags, {"CenterOfRotation"});
  const std::vector<double> matrix = header_numbers(matrix_text);
  const std::vector<double> offset = header_numbers(offset_text);
  const std::vector<double> spacing = header_numbers(spacing_text);
  const std::vector<double> centre = header_numbers(centre_text);
  if (!matrix_text.empty() && matrix.size() != 9) {
    return refuse_tag(path, "TransformMatrix", matrix_text, "must be nine numbers");
  }
  if (!offset_text.empty() && offset.size() != 3) {
    return refuse_tag(path, "Offset", offset_text, "must be three numbers");
  }
  if (spacing.size() != 3) {
    return refuse_tag(path, "ElementSpacing", spacing_text, "must be three numbers");
  }
  if (std::any_of(spacing.begin(), spacing.end(), [](double value) { return !(value > 0.0); })) {
    return refuse_tag(path, "ElementSpacing", spacing_text,
                      "must be above 0: whether a negative one mirrors the image is not stated");
  }
  constexpr double kRounding = 1e-3;
  for (std::size_t axis = 0; 3 * axis + 2 < matrix.size(); ++axis) {
    if (!(std::abs(Eigen::Vector3d(matrix.data() + 3 * axis).norm() - 1.0) <= kRounding)) {
      return refuse_tag(path, "TransformMatrix", matrix_text,
                        "its axes must have the length 1: whether another one scales the image is not stated");
    }
  }
  if (std::any_of(centre.begin(), centre.end(), [](double value) { return value != 0.0; })) {
    return refuse_tag(path, "CenterOfRotation", centre_text,
                      "programs disagree about a centre that is not 0; write the image with the centre 0");
  }
  Eigen::Vector3d signs(-1, -1, 1);
  if (matrix.empty()) {
    out.space_stated = false;
    out.notes.push_back(path.string() + ": its axes are not stated (TransformMatrix): " +
                        std::string(name_of(space.value_or(Space::kLps))) + " is assumed");
    signs = space == Space::kRas ? Eigen::Vector3d(1, 1, 1) : signs;
  }
  if (offset.empty()) {
    out.notes.push_back(path.string() + ": its Offset is not stated: 0 is assumed");
  }
  const Eigen::Matrix3d directions =
      matrix.empty()
          ? Eigen::Matrix3d::Identity()
          : Eigen::Matrix3d(Eigen::Map<const Eigen::Matrix3d>(matrix.data())); // its columns are the file's rows
  const Eigen::Vector3d at = offset.empty() ? Eigen::Vector3d::Zero() : Eigen::Vector3d(offset.data());
  out.T_ras_index.topLeftCorner<3, 3>() =
      signs.asDiagonal() * directions * Eigen::Vector3d(spacing.data()).asDiagonal();
  out.T_ras_index.topRightCorner<3, 1>() = signs.cwiseProduct(at);
  return unit_of_meta(path, tags, out).map([&out](double mm) { out.T_ras_index.topRows<3>() *= mm; });
}

// AnatomicalOrientation repeats the matrix in letters, which programs write from or towards the sides they name.
void note_letters(const fs::path &path, const Tags &tags, ImageHeader &out) {
  const std::string letters = first_of(tags, {"AnatomicalOrientation"});
  if (letters.size() != 3 || letters.find('?') != std::string::npos || !out.space_stated) {
    return;
  }
  std::string towards;
  std::string from;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    Eigen::Index along = 0;
    const Eigen::Vector3d column = out.T_ras_index.col(axis).head<3>();
    column.cwiseAbs().maxCoeff(&along);
    const bool positive = column[along] > 0.0;
    towards += positive ? "RAS"[along] : "LPI"[along];
    from += positive ? "LPI"[along] : "RAS"[along];
  }
  if (letters != towards && letters != from) {
    out.notes.push_back(path.string() + ": AnatomicalOrientation = " + letters +
                        " contradicts its matrix, which is used");
  }
}

// ITK reads as many bytes as stated, and what is left of the image is what its memory held.
base::Result<void> check_compressed_size(const fs::path &path, const Tags &tags, const StoredData &data) {
  const std::string stated = first_of(tags, {"CompressedDataSize"});
  const std::vector<double> bytes = header_numbers(stated);
  std::error_code error;
  const std::uintmax_t size = fs::file_size(data.file, error);
  if (!error && size >= data.begin && bytes.size() == 1 && bytes[0] == static_cast<double>(size - data.begin)) {
    return {};
  }
  return error ? base::failure(data.file.string() + ": " + error.message())
               : refuse_tag(path, "CompressedDataSize", stated,
                            "the compressed voxels have " + std::to_string(size >= data.begin ? size - data.begin : 0) +
                                " bytes");
}

base::Result<void> check_meta_data(const fs::path &path, const Tags &tags, std::uint64_t header_bytes,
                                   ImageHeader &header) {
  const std::string type = first_of(tags, {"ElementType"});
  const std::uint64_t each = bytes_of_element(type);
  if (each == 0) {
    return refuse_tag(path, "ElementType", type, "is not a type of numbers that is read");
  }
  const std::vector<double> channels = header_numbers(first_of(tags, {"ElementNumberOfChannels"}));
  const std::string file = first_of(tags, {"ElementDataFile"});
  const bool local = base::lower(file) == "local";
  if (!local &&
      (base::lower(file) == "list" || file.find('%') != std::string::npos || file.find(' ') != std::string::npos)) {
    return refuse_tag(path, "ElementDataFile", file, "several data files are not read");
  }
  StoredData data{local ? path : path.parent_path() / file, local ? header_bytes : 0,
                  is_true(first_of(tags, {"CompressedData"}))};
  const auto count = static_cast<std::uint64_t>(header.size[0]) * static_cast<std::uint64_t>(header.size[1]) *
                     static_cast<std::uint64_t>(header.size[2]) *
                     (channels.size() == 1 && channels[0] > 1.0 ? static_cast<std::uint64_t>(channels[0]) : 1);
  const std::string before = first_of(tags, {"HeaderSize"});
  const std::vector<double> skipped = header_numbers(before);
  if (local && std::any_of(skipped.begin(), skipped.end(), [](double bytes) { return bytes != 0.0; })) {
    return refuse_tag(path, "HeaderSize", before, "must be 0 where the voxels follow the header");
  }
  if (!before.empty() && !local) {
    // -1: the voxels are at the end of the file.
    if (skipped.size() != 1 || !(skipped[0] >= -1.0 && skipped[0] < 1e12)) {
      return refuse_tag(path, "HeaderSize", before, "must be a number of bytes, or -1");
    }
    data.begin = skipped[0] > 0.0 ? static_cast<std::uint64_t>(skipped[0]) : 0;
    if (skipped[0] < 0.0) {
      std::error_code error;
      const std::uintmax_t size = fs::file_size(data.file, error);
      data.begin = !error && !data.compressed && size > count * each ? size - count * each : 0;
      header.notes.push_back(data.file.string() +
                             ": its voxels are counted from its end: whether it is whole is not known");
    }
  }
  if (!first_of(tags, {"BinaryData"}).empty() && !is_true(first_of(tags, {"BinaryData"}))) {
    return refuse_tag(path, "BinaryData", "False", "voxels as text are not read");
  }
  for (const auto &[tag, usual] :
       {std::pair("ElementToIntensityFunctionSlope", 1.0), {"ElementToIntensityFunctionOffset", 0.0}}) {
    const std::string stated = first_of(tags, {tag});
    if (!stated.empty() && header_numbers(stated) != std::vector<double>{usual}) {
      return refuse_tag(path, tag, stated, "a scale of the values is not read");
    }
  }
  if (data.compressed) {
    if (auto agrees = check_compressed_size(path, tags, data); !agrees) {
      return agrees;
    }
  }
  return check_whole(data, count * each, path, header);
}

} // namespace

base::Result<ImageHeader> read_meta_header(const fs::path &path, std::optional<Space> space) {
  const auto text = read_text_header(path, [](std::string_view line) { return line.starts_with("ElementDataFile"); });
  if (!text) {
    return tl::unexpected(text.error());
  }
  Tags tags;
  for (const std::string &line : text->lines) {
    if (const std::size_t equals = line.find('='); equals != std::string::npos) {
      const std::string name = tag_name(std::string(base::trimmed(line.substr(0, equals))));
      const std::string value(base::trimmed(line.substr(equals + 1)));
      if (const auto [tag, fresh] = tags.emplace(name, value); !fresh && tag->second != value) {
        return tl::unexpected(refuse_tag(path, name, value, "is stated before as \"" + tag->second + "\"").error());
      }
    }
  }
  ImageHeader out;
  if (const std::string object = first_of(tags, {"ObjectType"}); !object.empty() && object != "Image") {
    return tl::unexpected(refuse_tag(path, "ObjectType", object, "is not Image").error());
  }
  return read_meta_size(path, tags, out)
      .and_then([&] { return place_meta(path, tags, space, out); })
      .and_then([&] {
        note_letters(path, tags, out);
        return check_meta_data(path, tags, text->bytes, out);
      })
      .map([&] { return out; });
}

} // namespace bregma::casefile
