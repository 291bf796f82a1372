// An XML file as a tree, by expat. Private to this library.
//
// expat itself limits the growth of entities. Entities that a file defines are refused here altogether, and nothing
// outside the file is ever read.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "casefile/surface_files/raw_surface.hpp"

namespace bregma::casefile::detail {

struct XmlElement {
  std::string name;
  std::map<std::string, std::string, std::less<>> attributes;
  std::string text; // the whole text without that of children
  std::vector<XmlElement> children;
  int line = 0;

  [[nodiscard]] const XmlElement *child(std::string_view wanted) const; // the first; null where there is none
  [[nodiscard]] std::string_view attribute(std::string_view key) const; // empty where it is missing
};

// The outermost element.
[[nodiscard]] Parsed<XmlElement> parse_xml(std::string_view content);

} // namespace bregma::casefile::detail
