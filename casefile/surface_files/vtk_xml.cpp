// VTK's serial XML polydata (.vtp). Arrays are text, base64 or appended data, uncompressed or compressed by zlib.
#include <array>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>

#include "base/text.hpp"
#include "casefile/surface_files/data_array.hpp"
#include "casefile/surface_files/mesh_arrays.hpp"
#include "casefile/surface_files/raw_surface.hpp"
#include "casefile/surface_files/text_cursor.hpp"
#include "casefile/surface_files/xml_document.hpp"

namespace bregma::casefile::detail {

namespace {

constexpr std::string_view kAppended = "<AppendedData";

std::optional<NumberType> xml_type(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, NumberType>, 10> kNames{{{"Int8", NumberType::kInt8},
                                                                            {"UInt8", NumberType::kUint8},
                                                                            {"Int16", NumberType::kInt16},
                                                                            {"UInt16", NumberType::kUint16},
                                                                            {"Int32", NumberType::kInt32},
                                                                            {"UInt32", NumberType::kUint32},
                                                                            {"Int64", NumberType::kInt64},
                                                                            {"UInt64", NumberType::kUint64},
                                                                            {"Float32", NumberType::kFloat},
                                                                            {"Float64", NumberType::kDouble}}};
  for (const auto &[known, type] : kNames) {
    if (known == name) {
      return type;
    }
  }
  return std::nullopt;
}

// The two parts of the file: well-formed XML without the appended data, and the appended data.
struct Parts {
  std::string xml;
  std::string_view appended; // after the underscore
  bool appended_in_base64 = false;
};

Parsed<Parts> parts_of(std::string_view content) {
  const std::size_t tag = content.find(kAppended);
  if (tag == std::string_view::npos) {
    return Parts{std::string(content), {}, false};
  }
  const std::size_t tag_end = content.find('>', tag);
  const std::size_t underscore = content.find('_', tag_end == std::string_view::npos ? content.size() : tag_end);
  if (underscore == std::string_view::npos) {
    return wrong_byte(tag, "AppendedData holds no data");
  }
  Parts out;
  out.xml = std::string(content.substr(0, tag)) + "</VTKFile>";
  out.appended = content.substr(underscore + 1);
  out.appended_in_base64 = content.substr(tag, tag_end - tag).find("base64") != std::string_view::npos;
  return out;
}

class XmlReader {
public:
  explicit XmlReader(const Parts &parts) : parts_(parts) {}

  Parsed<RawSurface> read(const XmlElement &file) {
    if (file.name != "VTKFile" || file.attribute("type") != "PolyData") {
      return wrong_line(file.line,
                        file.name + " of type " + in_quotes(file.attribute("type")) + ": only PolyData is read");
    }
    big_endian_ = file.attribute("byte_order") == "BigEndian";
    header_type_ = file.attribute("header_type") == "UInt64" ? NumberType::kUint64 : NumberType::kUint32;
    const std::string_view compressor = file.attribute("compressor");
    compressed_ = !compressor.empty();
    if (compressed_ && compressor != "vtkZLibDataCompressor") {
      return wrong_line(file.line, "compressor = " + in_quotes(compressor) + ": only vtkZLibDataCompressor is read");
    }
    const XmlElement *data = file.child("PolyData");
    const XmlElement *piece = data == nullptr ? nullptr : data->child("Piece");
    if (piece == nullptr) {
      return wrong_line(file.line, "has no Piece of PolyData");
    }
    surface_.format = "VTK XML";
    if (auto space = read_space(*data); !space) {
      return tl::unexpected(space.error());
    }
    for (const XmlElement &child : data->children) {
      if (child.name == "Piece" && &child != piece) {
        return wrong_line(child.line, "the surface is in several pieces, only one is read");
      }
    }
    if (auto done = read_piece(*piece); !done) {
      return tl::unexpected(done.error());
    }
    return std::move(surface_);
  }

private:
  // Written by Slicer: an array SPACE of one string in FieldData. In ASCII files its letters are character codes.
  Parsed<void> read_space(const XmlElement &data) {
    const XmlElement *field = data.child("FieldData");
    for (const XmlElement &array : field == nullptr ? std::vector<XmlElement>() : field->children) {
      if (array.attribute("Name") != "SPACE") {
        continue;
      }
      const auto letters = numbers(array, NumberType::kInt8, 4, "SPACE"); // three letters and a zero
      if (!letters) {
        return tl::unexpected(letters.error());
      }
      std::string name;
      for (const double letter : *letters) {
        name += letter > 0.0 && letter < 128.0 ? std::string(1, static_cast<char>(letter)) : std::string();
      }
      surface_.space = space_named(name);
      if (!surface_.space) {
        return wrong_line(array.line, "SPACE = " + in_quotes(name) + ": must be RAS or LPS");
      }
    }
    return {};
  }

  Parsed<void> read_piece(const XmlElement &piece) {
    const auto count = [&piece](std::string_view name) {
      return base::parsed_number<std::uint32_t>(piece.attribute(name)).value_or(0);
    };
    const std::size_t points = count("NumberOfPoints");
    const std::size_t polygons = count("NumberOfPolys");
    const std::size_t strips = count("NumberOfStrips");
    const XmlElement *point_list = piece.child("Points");
    const XmlElement *point_array = point_list == nullptr ? nullptr : point_list->child("DataArray");
    if (points == 0 || point_array == nullptr) {
      return wrong_line(piece.line,
                        "the surface is empty: NumberOfPoints = " + in_quotes(piece.attribute("NumberOfPoints")) +
                            ", NumberOfPolys = " + in_quotes(piece.attribute("NumberOfPolys")));
    }
    const auto coordinates = typed_numbers(*point_array, 3 * points, "the points");
    if (!coordinates) {
      return tl::unexpected(coordinates.error());
    }
    if (const auto problem = append_vertices(surface_.mesh, *coordinates); !problem.empty()) {
      return wrong_line(point_array->line, problem);
    }
    for (const auto &[name, kind, cells] :
         {std::tuple("Polys", Cells::kPolygons, polygons), {"Strips", Cells::kStrips, strips}}) {
      const XmlElement *list = piece.child(name);
      if (cells > 0 && list == nullptr) {
        return wrong_line(piece.line, std::string(name) + " are stated and missing");
      }
      if (auto read = cells > 0 ? read_cells(*list, kind, cells) : Parsed<void>(); !read) {
        return read;
      }
    }
    return {};
  }

  Parsed<void> read_cells(const XmlElement &list, Cells kind, std::size_t cells) {
    const XmlElement *corners = nullptr;
    const XmlElement *offsets = nullptr;
    for (const XmlElement &array : list.children) {
      corners = array.attribute("Name") == "connectivity" ? &array : corners;
      offsets = array.attribute("Name") == "offsets" ? &array : offsets;
    }
    if (corners == nullptr || offsets == nullptr) {
      return wrong_line(list.line, list.name + " has no connectivity or no offsets");
    }
    const auto ends = typed_numbers(*offsets, cells, "offsets");
    if (!ends) {
      return tl::unexpected(ends.error());
    }
    const double last = ends->back();
    constexpr double kMostCorners = 1e9; // far more than a file of the largest size holds
    if (!(last >= 0.0 && last <= kMostCorners)) {
      return wrong_line(offsets->line, "the last offset is no number of corners");
    }
    const auto connectivity = typed_numbers(*corners, static_cast<std::size_t>(last), "connectivity");
    if (!connectivity) {
      return tl::unexpected(connectivity.error());
    }
    const auto problem = append_cells(surface_.mesh, kind, *connectivity, *ends);
    return problem.empty() ? Parsed<void>() : wrong_line(corners->line, problem);
  }

  Parsed<std::vector<double>> typed_numbers(const XmlElement &array, std::size_t count, const std::string &what) const {
    const auto type = xml_type(array.attribute("type"));
    if (!type) {
      return wrong_line(array.line,
                        what + ": type = " + in_quotes(array.attribute("type")) + ": is not one of numbers");
    }
    return numbers(array, *type, count, what);
  }

  Parsed<std::vector<double>> numbers(const XmlElement &array, NumberType type, std::size_t count,
                                      const std::string &what) const {
    const std::string_view format = array.attribute("format");
    if (format == "ascii") {
      return numbers_in_words(array.text, count, array.line, what);
    }
    std::string_view source = array.text;
    bool base64 = true;
    if (format == "appended") {
      const auto offset = base::parsed_number<std::uint64_t>(array.attribute("offset"));
      if (!offset || *offset > parts_.appended.size()) {
        return wrong_line(array.line, what + ": offset = " + in_quotes(array.attribute("offset")) + ": " +
                                          std::to_string(parts_.appended.size()) + " bytes are appended");
      }
      source = parts_.appended.substr(*offset);
      base64 = parts_.appended_in_base64;
    } else if (format != "binary") {
      return wrong_line(array.line, what + ": format = " + in_quotes(format) + ": must be ascii, binary or appended");
    }
    auto bytes = block(source, base64, count * size_of(type));
    if (!bytes) {
      return wrong_line(array.line, what + ": " + bytes.error().what);
    }
    return numbers_of(*bytes, type, big_endian_);
  }

  // The bytes of an array. Uncompressed: one header word with the number of bytes precedes them. Compressed: the number
  // of blocks, the bytes per block, the bytes of a shorter last block and the packed size of each block precede them.
  Parsed<std::string> block(std::string_view source, bool base64, std::size_t size) const {
    const std::size_t word = size_of(header_type_);
    const auto bytes_to = [&](std::size_t wanted) {
      return base64 ? decode_base64(source, wanted) : std::string(source.substr(0, wanted));
    };
    const auto header = [&](const std::string &bytes, std::size_t index) {
      return static_cast<std::size_t>(
          std::clamp(load_number(bytes.data() + index * word, header_type_, big_endian_), 0.0, 1e12));
    };
    const std::size_t first = compressed_ ? 3 * word : word;
    const std::string start = bytes_to(first);
    if (start.size() < first) {
      return wrong("the data end before their header does");
    }
    if (!compressed_) {
      if (header(start, 0) != size) {
        return wrong("the file says " + std::to_string(header(start, 0)) + " bytes where " + std::to_string(size) +
                     " are needed");
      }
      const std::string all = bytes_to(first + size);
      return all.size() < first + size
                 ? Parsed<std::string>(wrong("the data end after " + std::to_string(all.size() - first) + " of " +
                                             std::to_string(size) + " bytes"))
                 : Parsed<std::string>(all.substr(first, size));
    }
    const std::size_t blocks = header(start, 0);
    const std::size_t block_size = header(start, 1);
    const std::size_t last_size = header(start, 2) == 0 ? block_size : header(start, 2);
    if (blocks == 0 || blocks > source.size() || last_size > block_size ||
        (blocks - 1) * block_size + last_size != size) {
      return wrong("the file says " + std::to_string(blocks) + " blocks of " + std::to_string(block_size) +
                   " bytes where " + std::to_string(size) + " bytes are needed");
    }
    const std::size_t data_start = (3 + blocks) * word;
    const std::string sizes = bytes_to(data_start);
    if (sizes.size() < data_start) {
      return wrong("the data end before their header does");
    }
    std::size_t packed = 0;
    for (std::size_t i = 0; i < blocks; ++i) {
      packed += header(sizes, 3 + i);
    }
    const std::string all = bytes_to(data_start + packed);
    std::string out;
    std::size_t at = data_start;
    for (std::size_t i = 0; i < blocks; ++i) {
      const std::size_t packed_size = header(sizes, 3 + i);
      if (all.size() - at < packed_size) {
        return wrong("the data end in block " + std::to_string(i) + " of " + std::to_string(blocks));
      }
      auto unpacked = inflated(std::string_view(all).substr(at, packed_size), i + 1 == blocks ? last_size : block_size);
      if (!unpacked) {
        return unpacked;
      }
      out += *unpacked;
      at += packed_size;
    }
    return out;
  }

  const Parts &parts_;
  RawSurface surface_;
  bool big_endian_ = false;
  bool compressed_ = false;
  NumberType header_type_ = NumberType::kUint32;
};

} // namespace

Parsed<RawSurface> parse_vtk_xml(std::string_view content) {
  const auto parts = parts_of(content);
  if (!parts) {
    return tl::unexpected(parts.error());
  }
  const auto document = parse_xml(parts->xml);
  return document ? XmlReader(*parts).read(*document) : tl::unexpected(document.error());
}

} // namespace bregma::casefile::detail
