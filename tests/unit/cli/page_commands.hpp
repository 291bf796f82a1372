// The commands that a page of docs/ shows: its indented lines, those that end with a backslash joined.
#pragma once

#include <algorithm>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "tests/unit/casefile/files.hpp"

namespace bregma::tests {

// The words after "bregma", in the order of the page, without comments.
inline std::vector<std::string> commands_of_page(const std::string &page) {
  std::vector<std::string> out;
  std::istringstream lines(read_file(std::string(BREGMA_SOURCE_DIR) + "/docs/" + page));
  bool continued = false;
  for (std::string line; std::getline(lines, line);) {
    const auto first = line.find_first_not_of(' ');
    const bool begins = first != std::string::npos && first >= 4 && line.substr(first).starts_with("bregma ");
    if (!begins && !continued) {
      continue;
    }
    std::string text = line.substr(begins ? first + std::string_view("bregma ").size() : first);
    text.erase(std::min(text.find(" # "), text.size()));
    continued = text.ends_with('\\');
    text.erase(continued ? text.size() - 1 : text.size());
    begins ? out.push_back(text) : static_cast<void>(out.back() += text);
  }
  return out;
}

// All indented lines of the section whose heading begins with "## <number>", without comments and indentation.
inline std::vector<std::string> lines_of_section(const std::string &page, const std::string &number) {
  std::vector<std::string> out;
  std::istringstream lines(read_file(std::string(BREGMA_SOURCE_DIR) + "/docs/" + page));
  bool inside = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("## ")) {
      inside = line.starts_with("## " + number);
    }
    const auto first = line.find_first_not_of(' ');
    if (inside && first != std::string::npos && first >= 4) {
      std::string text = line.substr(first);
      text.erase(std::min(text.find(" # "), text.size()));
      text.erase(text.find_last_not_of(' ') + 1);
      out.push_back(text);
    }
  }
  return out;
}

} // namespace bregma::tests
