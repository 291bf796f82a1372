// GIFTI surfaces (.surf.gii, version 1.0): one array of points, one of triangles.
//
// This reader uses expat and zlib instead of Debian's libgiftiio. The format is two arrays in XML with the encodings of
// a .vtp file, and error messages must name the line and the value.
#include <array>
#include <optional>
#include <utility>

#include "base/text.hpp"
#include "casefile/surface_files/data_array.hpp"
#include "casefile/surface_files/mesh_arrays.hpp"
#include "casefile/surface_files/raw_surface.hpp"
#include "casefile/surface_files/text_cursor.hpp"
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
    const std::string problem =
        out.mesh.vertices_mm.empty() ? append_vertices(out.mesh, *numbers) : append_triangles(out.mesh, *numbers);
    if (!problem.empty()) {
      return wrong_line(found->line, problem);
    }
  }
  return out;
}

} // namespace bregma::casefile::detail
