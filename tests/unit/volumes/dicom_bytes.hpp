// Bytes of DICOM files, explicit and little endian, for tests of files that no program here writes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace bregma::test {

inline std::string little(std::uint32_t value, std::size_t bytes) {
  std::string out;
  for (std::size_t i = 0; i < bytes; ++i) {
    out.push_back(static_cast<char>(value >> (8 * i) & 0xFF));
  }
  return out;
}

inline std::string tag(std::uint32_t group, std::uint32_t element) { return little(group, 2) + little(element, 2); }

inline std::string short_element(std::uint32_t group, std::uint32_t element, const std::string &vr,
                                 const std::string &value) {
  return tag(group, element) + vr + little(static_cast<std::uint32_t>(value.size()), 2) + value;
}

inline std::string long_element(std::uint32_t group, std::uint32_t element, const std::string &vr, std::uint32_t length,
                                const std::string &value) {
  return tag(group, element) + vr + std::string(2, '\0') + little(length, 4) + value;
}

inline std::string item(std::uint32_t length, const std::string &content) {
  return tag(0xFFFE, 0xE000) + little(length, 4) + content;
}
inline const std::string kItemEnd = tag(0xFFFE, 0xE00D) + little(0, 4);
inline const std::string kSequenceEnd = tag(0xFFFE, 0xE0DD) + little(0, 4);

} // namespace bregma::test
