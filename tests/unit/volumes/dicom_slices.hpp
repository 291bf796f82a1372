// A DICOM series of an image, for tests: one file per slice, 16 bits, explicit and little endian.
#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <sstream>
#include <string>

#include "algorithms/image/grid.hpp"
#include "tests/unit/volumes/dicom_bytes.hpp"
#include "tests/unit/volumes/files.hpp"

namespace bregma::test {

inline std::string uid_element(std::uint32_t group, std::uint32_t element, std::string value) {
  value.append(value.size() % 2, '\0');
  return short_element(group, element, "UI", value);
}
inline std::string text_element(std::uint32_t group, std::uint32_t element, const char *type, std::string value) {
  value.append(value.size() % 2, ' ');
  return short_element(group, element, type, value);
}

// Of an image whose axes are those of RAS; negative values become 0.
inline std::string dicom_slice(const image::Image<float, 3> &image, int k) {
  const auto decimals = [](std::initializer_list<double> values) {
    std::ostringstream out;
    out.precision(9);
    for (const double value : values) {
      out << (out.tellp() > 0 ? "\\" : "") << value;
    }
    return out.str();
  };
  const auto count = [](std::uint32_t element, std::uint32_t value) {
    return short_element(0x0028, element, "US", little(value, 2));
  };
  const Eigen::Vector3d first = image.point_mm(Eigen::Vector3d(0, 0, k));
  const Eigen::Vector3d spacing = image.spacing_mm();
  std::string pixels;
  for (int j = 0; j < image.size[1]; ++j) {
    for (int i = 0; i < image.size[0]; ++i) {
      pixels += little(static_cast<std::uint32_t>(std::lround(std::max(image.at(i, j, k), 0.0F))), 2);
    }
  }
  const std::string storage = "1.2.840.10008.5.1.4.1.1.4";
  const std::string instance = "1.2.3.4." + std::to_string(k + 1);
  const std::string meta =
      uid_element(2, 2, storage) + uid_element(2, 3, instance) + uid_element(2, 0x10, "1.2.840.10008.1.2.1");
  return std::string(128, '\0') + "DICM" +
         short_element(2, 0, "UL", little(static_cast<std::uint32_t>(meta.size()), 4)) + meta +
         uid_element(0x0008, 0x0016, storage) + uid_element(0x0008, 0x0018, instance) +
         text_element(0x0008, 0x0060, "CS", "MR") + text_element(0x0010, 0x0010, "PN", "Doe^Jane") +
         uid_element(0x0020, 0x000D, "1.2.3.5") + uid_element(0x0020, 0x000E, "1.2.3.6") +
         text_element(0x0020, 0x0013, "IS", std::to_string(k + 1)) +
         text_element(0x0020, 0x0032, "DS", decimals({-first.x(), -first.y(), first.z()})) +
         text_element(0x0020, 0x0037, "DS", "-1\\0\\0\\0\\-1\\0") + count(0x0002, 1) +
         text_element(0x0028, 0x0004, "CS", "MONOCHROME2") + count(0x0010, static_cast<std::uint32_t>(image.size[1])) +
         count(0x0011, static_cast<std::uint32_t>(image.size[0])) +
         text_element(0x0028, 0x0030, "DS", decimals({spacing.y(), spacing.x()})) + count(0x0100, 16) +
         count(0x0101, 16) + count(0x0102, 15) + count(0x0103, 0) +
         long_element(0x7FE0, 0x0010, "OW", static_cast<std::uint32_t>(pixels.size()), pixels);
}

// Makes the folder.
inline void write_dicom(const std::filesystem::path &folder, const image::Image<float, 3> &image) {
  std::filesystem::create_directory(folder);
  for (int k = 0; k < image.size[2]; ++k) {
    write_bytes(folder / ("IM" + std::to_string(k)), dicom_slice(image, k));
  }
}

} // namespace bregma::test
