#include "casefile/ply.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <sstream>
#include <vector>

#include "algorithms/geometry/unknown.hpp"

namespace bregma::casefile::detail {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they stand in the file");

namespace {

using surface::TriangleMesh;

enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

struct Property {
  std::string name;
  PlyType type = PlyType::kFloat;
  std::optional<PlyType> count_type; // type of a list's count
};

struct Element {
  std::string name;
  std::size_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  bool ascii = false, big_endian = false;
  std::vector<Element> elements;
};

template <class T> using Parsed = tl::expected<T, std::string>;

tl::unexpected<std::string> wrong(std::string what) { return tl::unexpected<std::string>(std::move(what)); }

std::optional<PlyType> type_of(const std::string &name) {
  static constexpr std::array<std::pair<const char *, PlyType>, 16> kNames{{{"char", PlyType::kInt8},
                                                                            {"int8", PlyType::kInt8},
                                                                            {"uchar", PlyType::kUint8},
                                                                            {"uint8", PlyType::kUint8},
                                                                            {"short", PlyType::kInt16},
                                                                            {"int16", PlyType::kInt16},
                                                                            {"ushort", PlyType::kUint16},
                                                                            {"uint16", PlyType::kUint16},
                                                                            {"int", PlyType::kInt32},
                                                                            {"int32", PlyType::kInt32},
                                                                            {"uint", PlyType::kUint32},
                                                                            {"uint32", PlyType::kUint32},
                                                                            {"float", PlyType::kFloat},
                                                                            {"float32", PlyType::kFloat},
                                                                            {"double", PlyType::kDouble},
                                                                            {"float64", PlyType::kDouble}}};
  for (const auto &[known, type] : kNames) {
    if (name == known) {
      return type;
    }
  }
  return std::nullopt;
}

// Removes the header from the front of the content.
Parsed<Header> take_header(std::string_view &content) {
  const auto next_line = [&content]() -> std::optional<std::string> {
    const std::size_t end = content.find('\n');
    if (end == std::string_view::npos) {
      return std::nullopt;
    }
    std::string line(content.substr(0, end));
    content.remove_prefix(end + 1);
    return !line.empty() && line.back() == '\r' ? line.substr(0, line.size() - 1) : line;
  };
  if (next_line() != "ply") {
    return wrong("is not a PLY file");
  }
  Header header;
  std::string format;
  while (const auto line = next_line()) {
    std::istringstream words(*line);
    std::string keyword;
    words >> keyword;
    if (keyword == "end_header") {
      header.ascii = format == "ascii";
      header.big_endian = format == "binary_big_endian";
      return header.ascii || header.big_endian || format == "binary_little_endian"
                 ? Parsed<Header>(std::move(header))
                 : wrong("its format is \"" + format +
                         "\", only ascii, binary_little_endian and binary_big_endian are read");
    }
    if (keyword == "format") {
      words >> format;
    } else if (keyword == "element") {
      Element element;
      if (!(words >> element.name >> element.count)) {
        return wrong("the header says \"" + *line + "\"");
      }
      header.elements.push_back(std::move(element));
    } else if (keyword == "property") {
      std::string word;
      words >> word;
      Property property;
      const bool list = word == "list";
      if (list) {
        std::string count_type;
        words >> count_type >> word;
        property.count_type = type_of(count_type);
      }
      const auto type = type_of(word);
      words >> property.name;
      if (!type || (list && !property.count_type) || header.elements.empty() || property.name.empty()) {
        return wrong("the header says \"" + *line + "\"");
      }
      property.type = *type;
      header.elements.back().properties.push_back(std::move(property));
    }
  }
  return wrong("the PLY header has no end");
}

// Reads the numbers after the header one by one. Empty at the end of the file or if there is no number.
class Body {
public:
  Body(std::string_view content, const Header &header)
      : content_(content), ascii_(header.ascii), big_endian_(header.big_endian) {}

  std::optional<double> next(PlyType type) { return ascii_ ? next_word() : next_bytes(type); }
  [[nodiscard]] std::size_t left() const { return content_.size(); }
  // Nothing but white space follows.
  [[nodiscard]] bool at_end() const { return content_.find_first_not_of(" \t\r\n") == std::string_view::npos; }

private:
  std::optional<double> next_word() {
    const std::size_t start = content_.find_first_not_of(" \t\r\n");
    if (start == std::string_view::npos) {
      return std::nullopt;
    }
    content_.remove_prefix(start);
    double value = 0.0;
    const auto parsed = std::from_chars(content_.data(), content_.data() + content_.size(), value);
    if (parsed.ec != std::errc()) { // not a number, or one that no double holds
      return std::nullopt;
    }
    content_.remove_prefix(static_cast<std::size_t>(parsed.ptr - content_.data()));
    return value;
  }

  template <class T> std::optional<double> take() {
    T value{};
    if (content_.size() < sizeof(T)) {
      return std::nullopt;
    }
    std::array<char, sizeof(T)> bytes{};
    std::copy_n(content_.data(), sizeof(T), bytes.begin());
    if (big_endian_) {
      std::reverse(bytes.begin(), bytes.end());
    }
    std::memcpy(&value, bytes.data(), sizeof(T));
    content_.remove_prefix(sizeof(T));
    return static_cast<double>(value);
  }

  std::optional<double> next_bytes(PlyType type) {
    switch (type) {
    case PlyType::kInt8:
      return take<std::int8_t>();
    case PlyType::kUint8:
      return take<std::uint8_t>();
    case PlyType::kInt16:
      return take<std::int16_t>();
    case PlyType::kUint16:
      return take<std::uint16_t>();
    case PlyType::kInt32:
      return take<std::int32_t>();
    case PlyType::kUint32:
      return take<std::uint32_t>();
    case PlyType::kFloat:
      return take<float>();
    case PlyType::kDouble:
      break;
    }
    return take<double>();
  }

  std::string_view content_;
  bool ascii_, big_endian_;
};

// One vertex, face or other element: its coordinates and its list, if it has them.
struct Item {
  Eigen::Vector3d position = Eigen::Vector3d::Constant(geometry::kUnknown);
  std::vector<int> corners; // -1: not an index, or between two strips
};

std::optional<Item> read_item(const Element &element, Body &body) {
  Item item;
  for (const Property &property : element.properties) {
    const auto first = body.next(property.count_type.value_or(property.type));
    if (!first) {
      return std::nullopt;
    }
    if (!property.count_type) {
      const auto axis = std::string_view("xyz").find(property.name);
      if (property.name.size() == 1 && axis != std::string_view::npos) {
        item.position[static_cast<Eigen::Index>(axis)] = *first;
      }
      continue;
    }
    const bool corners = property.name == "vertex_indices" || property.name == "vertex_index";
    if (!(*first >= 0.0 && *first <= std::numeric_limits<std::uint32_t>::max())) {
      return std::nullopt;
    }
    const auto count = static_cast<std::uint32_t>(*first);
    for (std::uint32_t i = 0; i < count; ++i) {
      const auto value = body.next(property.type);
      if (!value) {
        return std::nullopt;
      }
      const bool index = *value >= 0.0 && *value <= std::numeric_limits<int>::max();
      if (corners) {
        item.corners.push_back(index ? static_cast<int>(*value) : -1);
      }
    }
  }
  return item;
}

// A polygon as triangles around its first corner: exact for a flat convex one.
void append_polygon(const std::vector<int> &corners, TriangleMesh &mesh) {
  for (std::size_t i = 2; i < corners.size(); ++i) {
    mesh.triangles.emplace_back(corners[0], corners[i - 1], corners[i]);
  }
}

// Strips, each of which ends with -1: every corner from the third on makes a triangle with the two before it, in
// alternating order.
void append_strips(const std::vector<int> &corners, TriangleMesh &mesh) {
  std::size_t begin = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] < 0) {
      begin = i + 1;
    } else if (i >= begin + 2) {
      const bool turned = (i - begin) % 2 != 0;
      mesh.triangles.emplace_back(corners[i - 2], corners[turned ? i : i - 1], corners[turned ? i - 1 : i]);
    }
  }
}

template <class T> void append(std::string &out, T value) {
  std::array<char, sizeof(T)> bytes{};
  std::memcpy(bytes.data(), &value, sizeof(T));
  out.append(bytes.data(), bytes.size());
}

} // namespace

tl::expected<TriangleMesh, std::string> parse_ply(std::string_view content) {
  const auto header = take_header(content);
  if (!header) {
    return wrong(header.error());
  }
  Body body(content, *header);
  TriangleMesh mesh;
  for (const Element &element : header->elements) {
    for (std::size_t i = 0; i < element.count; ++i) {
      const auto item = read_item(element, body);
      if (!item) {
        return wrong("ends or is damaged at " + element.name + " " + std::to_string(i) + " of " +
                     std::to_string(element.count));
      }
      if (element.properties.empty()) {
        break; // elements without properties: nothing to read, for any count
      }
      if (element.name == "vertex") {
        mesh.vertices_mm.push_back(item->position);
      } else if (element.name == "face") {
        if (item->corners.size() < 3) {
          return wrong("face " + std::to_string(i) + " has " + std::to_string(item->corners.size()) +
                       " corners, a face has three at least");
        }
        append_polygon(item->corners, mesh);
      } else if (element.name == "tristrips") {
        append_strips(item->corners, mesh);
      }
    }
  }
  if (!body.at_end()) {
    return wrong("holds more than its header states: is it the header of another surface?");
  }
  return mesh.vertices_mm.empty() ? Parsed<TriangleMesh>(wrong("holds no vertices")) : mesh;
}

std::string to_ply(const TriangleMesh &mesh) {
  std::string out = "ply\nformat binary_little_endian 1.0\ncomment Bregma: RAS, mm\nelement vertex " +
                    std::to_string(mesh.vertices_mm.size()) +
                    "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
                    std::to_string(mesh.triangles.size()) + "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const Eigen::Vector3d &v : mesh.vertices_mm) {
    for (const double coordinate : v) {
      append(out, static_cast<float>(coordinate));
    }
  }
  for (const Eigen::Vector3i &t : mesh.triangles) {
    append(out, std::uint8_t{3});
    for (const int corner : t) {
      append(out, static_cast<std::int32_t>(corner));
    }
  }
  return out;
}

} // namespace bregma::casefile::detail
