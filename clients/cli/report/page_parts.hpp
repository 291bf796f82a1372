// Parts of a self-contained page: tables, sections, cards, pictures. The style is that of page_style.hpp.
// Texts are escaped here and nowhere else; `content` is HTML already.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.hpp"
#include "casefile/volumes/render.hpp"

namespace bregma::cli::report {

// A column whose heading begins with '#' contains figures and is right-aligned.
class HtmlTable {
public:
  explicit HtmlTable(const std::vector<std::string> &headings);
  // verdict: sets the colour of the last cell ("yes", "no" or none).
  void row(const std::vector<std::string> &cells, const char *verdict = "");
  [[nodiscard]] bool any() const { return any_; }
  [[nodiscard]] std::string text() const { return out_ + "</tbody></table></div>"; }

private:
  std::vector<bool> figures_;
  std::string out_;
  bool any_ = false;
};

// Empty without content.
[[nodiscard]] std::string section(std::string_view heading, const std::string &content, std::string_view kind = {});
[[nodiscard]] std::string card(std::string_view name, const std::string &value, std::string_view remark);
// Two figures side by side in a section, and two sections side by side.
[[nodiscard]] std::string pair(const std::string &left, const std::string &right);
[[nodiscard]] std::string columns(const std::string &left, const std::string &right);

// The page around its body. title is plain text.
[[nodiscard]] std::string page(std::string_view title, const std::string &body);

// A picture in the page itself, with its caption below: for a grid of class 'heads'. An error only when it cannot be
// encoded.
[[nodiscard]] base::Result<std::string> picture_cell(const casefile::Image &image, std::string_view alternative,
                                                     std::string_view caption);

[[nodiscard]] std::string base64(const std::vector<std::uint8_t> &bytes);

} // namespace bregma::cli::report
