#include "drivers/sim/scanner/dicom_slice.hpp"

#include <cstdio>
#include <cstring>
#include <string_view>

namespace bregma::sim::scanner {

namespace {

constexpr std::string_view kMrImage = "1.2.840.10008.5.1.4.1.1.4";
constexpr std::string_view kExplicitLittleEndian = "1.2.840.10008.1.2.1";

class Elements {
public:
  void number16(unsigned group, unsigned element, unsigned value) {
    head(group, element, "US", 2);
    append16(value);
  }
  // Padded to an even length: identifiers by zero, other texts by a blank.
  void text(unsigned group, unsigned element, const char *vr, std::string_view value) {
    const bool odd = value.size() % 2 != 0;
    head(group, element, vr, value.size() + (odd ? 1 : 0));
    bytes_ += value;
    if (odd) {
      bytes_ += std::strcmp(vr, "UI") == 0 ? '\0' : ' ';
    }
  }
  void decimals(unsigned group, unsigned element, std::initializer_list<double> values) {
    std::string out;
    for (const double value : values) {
      char digits[32]; // at most 16 bytes in a decimal string
      std::snprintf(digits, sizeof digits, "%.8g", value);
      out += (out.empty() ? "" : "\\") + std::string(digits);
    }
    text(group, element, "DS", out);
  }
  void raw(unsigned group, unsigned element, const char *vr, std::string_view value) { // VRs with long lengths
    append16(group);
    append16(element);
    bytes_ += vr;
    append16(0);
    append32(static_cast<std::uint32_t>(value.size()));
    bytes_ += value;
  }
  void number32(unsigned group, unsigned element, std::uint32_t value) {
    head(group, element, "UL", 4);
    append32(value);
  }
  [[nodiscard]] const std::string &bytes() const { return bytes_; }

private:
  void head(unsigned group, unsigned element, const char *vr, std::size_t length) {
    append16(group);
    append16(element);
    bytes_ += vr;
    append16(static_cast<unsigned>(length));
  }
  void append16(unsigned value) {
    bytes_ += static_cast<char>(value & 0xFFU);
    bytes_ += static_cast<char>(value >> 8U & 0xFFU);
  }
  void append32(std::uint32_t value) {
    append16(value & 0xFFFFU);
    append16(value >> 16U);
  }
  std::string bytes_;
};

} // namespace

std::string dicom_bytes(const DicomSlice &s) {
  Elements meta;
  meta.raw(0x0002, 0x0001, "OB", std::string_view("\0\1", 2));
  meta.text(0x0002, 0x0002, "UI", kMrImage);
  meta.text(0x0002, 0x0003, "UI", s.instance_uid);
  meta.text(0x0002, 0x0010, "UI", kExplicitLittleEndian);
  meta.text(0x0002, 0x0012, "UI", "2.25.100000000000000000000000000000000001");
  Elements length;
  length.number32(0x0002, 0x0000, static_cast<std::uint32_t>(meta.bytes().size()));

  Elements data;
  data.text(0x0008, 0x0008, "CS", std::string("ORIGINAL\\PRIMARY\\M\\") + (s.vendor_corrected ? "DIS3D" : "ND"));
  data.text(0x0008, 0x0016, "UI", kMrImage);
  data.text(0x0008, 0x0018, "UI", s.instance_uid);
  data.text(0x0008, 0x0020, "DA", s.date);
  data.text(0x0008, 0x0022, "DA", s.date);
  data.text(0x0008, 0x0060, "CS", "MR");
  data.text(0x0008, 0x0070, "LO", "Bregma");
  data.text(0x0008, 0x103E, "LO", s.description);
  data.text(0x0008, 0x1090, "LO", "simulated scanner");
  data.text(0x0010, 0x0010, "PN", "Phantom");
  data.text(0x0010, 0x0020, "LO", "phantom");
  data.text(0x0018, 0x0023, "CS", "2D");
  data.decimals(0x0018, 0x0050, {s.thickness_mm});
  data.decimals(0x0018, 0x0080, {s.repetition_ms});
  data.decimals(0x0018, 0x0081, {s.echo_ms});
  data.decimals(0x0018, 0x0087, {3.0});
  data.decimals(0x0018, 0x0088, {s.thickness_mm});
  data.decimals(0x0018, 0x0095, {s.bandwidth_Hz});
  data.text(0x0018, 0x1312, "CS", s.phase_along_columns ? "COL" : "ROW");
  data.text(0x0018, 0x5100, "CS", s.patient_position);
  data.text(0x0020, 0x000D, "UI", s.study_uid);
  data.text(0x0020, 0x000E, "UI", s.series_uid);
  data.text(0x0020, 0x0011, "IS", std::to_string(s.series));
  data.text(0x0020, 0x0013, "IS", std::to_string(s.instance));
  data.decimals(0x0020, 0x0032, {s.position_mm.x(), s.position_mm.y(), s.position_mm.z()});
  data.decimals(
      0x0020, 0x0037,
      {s.along_row.x(), s.along_row.y(), s.along_row.z(), s.along_column.x(), s.along_column.y(), s.along_column.z()});
  data.text(0x0020, 0x0052, "UI", s.study_uid + ".1");
  data.number16(0x0028, 0x0002, 1);
  data.text(0x0028, 0x0004, "CS", "MONOCHROME2");
  data.number16(0x0028, 0x0010, static_cast<unsigned>(s.rows));
  data.number16(0x0028, 0x0011, static_cast<unsigned>(s.columns));
  data.decimals(0x0028, 0x0030, {s.row_spacing_mm, s.column_spacing_mm});
  data.number16(0x0028, 0x0100, 16);
  data.number16(0x0028, 0x0101, 16);
  data.number16(0x0028, 0x0102, 15);
  data.number16(0x0028, 0x0103, 0);
  std::string pixels;
  pixels.reserve(2 * s.pixels.size());
  for (const std::uint16_t p : s.pixels) {
    pixels += static_cast<char>(p & 0xFFU);
    pixels += static_cast<char>(p >> 8U);
  }
  data.raw(0x7FE0, 0x0010, "OW", pixels);
  return std::string(128, '\0') + "DICM" + length.bytes() + meta.bytes() + data.bytes();
}

} // namespace bregma::sim::scanner
