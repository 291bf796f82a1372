// GIFTI surfaces (.surf.gii, version 1.0): one array of points, one of triangles.
//
// This reader uses expat and zlib instead of Debian's libgiftiio. The format is two arrays in XML with the encodings of
// a .vtp file, and error messages must name the line and the value.
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "base/text.hpp"
#include "casefile/surface_files/data_array.hpp"
#include "casefile/surface_files/mesh_arrays.hpp"
#include "casefile/surface_files/raw_surface.hpp"
#include "casefile/surface_files/text_cursor.hpp"
#include "casefile/surface_files/volume_geometry.hpp"
#include "casefile/surface_files/xml_document.hpp"

namespace bregma::casefile::detail {

namespace {

std::optional<NumberType> gifti_type(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, NumberType>, 6> kNames{
      {{"NIFTI_TYPE_UINT8", NumberType::kUint8},
       {"NIFTI_TYPE_INT32", NumberType::kInt32},
       {"NIFTI_TYPE_UINT32", NumberType::kUint32},
       {"NIFTI_TYPE_INT64", NumberType::kInt64},
       {"NIFTI_TYPE_FLOAT32", NumberType::kFloat},
       {"NIFTI_TYPE_FLOAT64", NumberType::kDouble}}};
  for (const auto &[known, type] : kNames) {
    if (known == name) {
      return type;
    }
  }
  return std::nullopt;
}

// Columns of three values, in the order of the file's rows.
Parsed<std::vector<double>> gifti_array(const XmlElement &array, const std::string &what) {
  const auto wrong_here = [&array](const std::string &text) { return wrong_line(array.line, text); };
  const auto type = gifti_type(array.attribute("DataType"));
  if (!type) {
    return wrong_here(what + ": DataType = " + in_quotes(array.attribute("DataType")) + ": is not a type that is read");
  }
  const auto rows = base::parsed_number<std::uint32_t>(array.attribute("Dim0"));
  if (!rows || array.attribute("Dim1") != "3" || array.attribute("Dimensionality") != "2") {
    return wrong_here(what + ": Dim0 = " + in_quotes(array.attribute("Dim0")) +
                      ", Dim1 = " + in_quotes(array.attribute("Dim1")) + ": must be rows of 3");
  }
  const XmlElement *data = array.child("Data");
  if (data == nullptr) {
    return wrong_here(what + ": has no Data");
  }
  const std::size_t count = std::size_t{3} * *rows;
  const std::size_t bytes = count * size_of(*type);
  const std::string_view encoding = array.attribute("Encoding");
  const bool big_endian = array.attribute("Endian") == "BigEndian";
  std::vector<double> out;
  if (encoding == "ASCII") {
    auto read = numbers_in_words(data->text, count, data->line, what);
    if (!read) {
      return read;
    }
    out = std::move(*read);
  } else if (encoding == "Base64Binary" || encoding == "GZipBase64Binary") {
    std::string decoded = decode_base64(data->text, data->text.size());
    if (encoding == "GZipBase64Binary") {
      auto unpacked = inflated(decoded, bytes);
      if (!unpacked) {
        return wrong_line(data->line, what + ": " + unpacked.error().what);
      }
      decoded = std::move(*unpacked);
    }
    if (decoded.size() != bytes) {
      return wrong_line(data->line, what + ": " + std::to_string(decoded.size()) + " bytes where Dim0 = " +
                                        std::to_string(*rows) + " needs " + std::to_string(bytes));
    }
    out = numbers_of(decoded, *type, big_endian);
  } else {
    return wrong_here(what + ": Encoding = " + in_quotes(encoding) + ": only data in the file itself are read");
  }
  if (array.attribute("ArrayIndexingOrder") == "ColumnMajorOrder") {
    std::vector<double> by_rows(out.size());
    for (std::size_t i = 0; i < out.size(); ++i) {
      by_rows[3 * (i % *rows) + i / *rows] = out[i];
    }
    out = std::move(by_rows);
  }
  return out;
}

// Without blanks and line ends around it.
std::string_view stripped(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kBlank);
  return first == std::string_view::npos ? std::string_view()
                                         : text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::string text_of(const XmlElement &parent, std::string_view name) {
  const XmlElement *child = parent.child(name);
  return child != nullptr ? std::string(stripped(child->text)) : "";
}

constexpr std::string_view kScanner = "NIFTI_XFORM_SCANNER_ANAT";

// VolGeomX_R ... VolGeomC_S in the metadata, which FreeSurfer writes.
Parsed<VolumeGeometry> gifti_geometry(const XmlElement &points) {
  VolumeGeometry out;
  int found = 0;
  const XmlElement *metadata = points.child("MetaData");
  for (const XmlElement &entry : metadata != nullptr ? metadata->children : std::vector<XmlElement>()) {
    const std::string name = text_of(entry, "Name");
    constexpr std::string_view kPrefix = "VolGeom";
    const std::size_t column = name.size() == kPrefix.size() + 3 ? std::string_view("XYZC").find(name[kPrefix.size()])
                                                                 : std::string_view::npos;
    const std::size_t row = name.empty() ? std::string_view::npos : std::string_view("RAS").find(name.back());
    if (!name.starts_with(kPrefix) || column == std::string_view::npos || row == std::string_view::npos) {
      continue;
    }
    const std::string text = text_of(entry, "Value");
    const auto value = base::parsed_number<double>(text);
    if (!value || !std::isfinite(*value)) {
      return wrong_line(entry.line, name + " = " + in_quotes(text) + ": must be a finite number");
    }
    const auto axis = static_cast<Eigen::Index>(row);
    (column < 3 ? out.axes(axis, static_cast<Eigen::Index>(column)) : out.centre[axis]) = *value;
    ++found;
  }
  if (found != 0 && (found != 12 || !out.has_axes())) {
    return wrong_line(points.line, "VolGeom: must be 12 numbers, with axes at right angles");
  }
  out.valid = found == 12;
  return out;
}

Parsed<Eigen::Matrix4d> stated_matrix(const XmlElement &transform) {
  const XmlElement *data = transform.child("MatrixData");
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  if (data == nullptr) {
    return out;
  }
  const auto numbers = numbers_in_words(data->text, 16, data->line, "MatrixData");
  if (!numbers) {
    return tl::unexpected(numbers.error());
  }
  out = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(numbers->data());
  const Eigen::Matrix3d R = out.topLeftCorner<3, 3>();
  if (!out.allFinite() || !(std::abs(R.determinant()) > 1e-6)) {
    return wrong_line(data->line, "MatrixData: is no transform that can be inverted");
  }
  return out;
}

// Applies what the array of points states about its frame, so that they lie in scanner RAS.
Parsed<void> place_points(const XmlElement &points, RawSurface &out) {
  const auto geometry = gifti_geometry(points);
  if (!geometry) {
    return tl::unexpected(geometry.error());
  }
  bool in_scanner = false;
  for (const XmlElement &transform : points.children) {
    if (transform.name != "CoordinateSystemTransformMatrix") {
      continue;
    }
    const auto matrix = stated_matrix(transform);
    if (!matrix) {
      return tl::unexpected(matrix.error());
    }
    in_scanner = in_scanner || text_of(transform, "DataSpace") == kScanner;
    if (in_scanner || matrix->isIdentity(1e-6)) {
      continue;
    }
    const std::string to = text_of(transform, "TransformedSpace");
    if (to != kScanner) {
      out.notes.push_back("its transform to " + to + " is not applied");
      continue;
    }
    for (Eigen::Vector3d &vertex : out.mesh.vertices_mm) {
      vertex = (*matrix * vertex.homogeneous()).head<3>();
    }
    out.notes.emplace_back("its transform to scanner coordinates is applied");
    out.space = Space::kRas;
    return {};
  }
  if (in_scanner || geometry->valid) {
    out.space = Space::kRas; // as stated: an option does not change it
  }
  if (!in_scanner && geometry->valid) {
    for (Eigen::Vector3d &vertex : out.mesh.vertices_mm) {
      vertex = geometry->scanner_ras(vertex);
    }
    out.notes.emplace_back("its points are FreeSurfer's surface RAS: moved to scanner RAS by its volume geometry");
  }
  return {};
}

} // namespace

Parsed<RawSurface> parse_gifti(std::string_view content) {
  const auto document = parse_xml(content);
  if (!document) {
    return tl::unexpected(document.error());
  }
  if (document->name != "GIFTI") {
    return wrong_line(document->line, in_quotes(document->name) + " where GIFTI is expected");
  }
  RawSurface out;
  out.format = "GIFTI";
  out.assumed_space = Space::kRas; // the coordinates of NIfTI
  for (const auto &[intent, what] :
       {std::pair("NIFTI_INTENT_POINTSET", "the points"), {"NIFTI_INTENT_TRIANGLE", "the triangles"}}) {
    const XmlElement *found = nullptr;
    for (const XmlElement &array : document->children) {
      if (array.name != "DataArray" || array.attribute("Intent") != intent) {
        continue;
      }
      if (found != nullptr) {
        return wrong_line(array.line, std::string("the file has two arrays ") + intent);
      }
      found = &array;
    }
    if (found == nullptr) {
      return wrong(std::string("has no array ") + intent + ": it is not a surface");
    }
    const auto numbers = gifti_array(*found, what);
    if (!numbers) {
      return tl::unexpected(numbers.error());
    }
    const bool points = out.mesh.vertices_mm.empty();
    const std::string problem = points ? append_vertices(out.mesh, *numbers) : append_triangles(out.mesh, *numbers);
    if (!problem.empty()) {
      return wrong_line(found->line, problem);
    }
    if (const auto placed = points ? place_points(*found, out) : Parsed<void>(); !placed) {
      return tl::unexpected(placed.error());
    }
  }
  return out;
}

} // namespace bregma::casefile::detail
