#include "clients/cli/report/page_parts.hpp"

#include <algorithm>

#include "base/plots.hpp"
#include "clients/cli/report/page_style.hpp"

namespace bregma::cli::report {

HtmlTable::HtmlTable(const std::vector<std::string> &headings) {
  out_ = "<div class='scroll'><table><thead><tr>";
  for (const auto &heading : headings) {
    figures_.push_back(heading.starts_with('#'));
    out_ += std::string(figures_.back() ? "<th class='n'>" : "<th>") +
            base::escape(heading.substr(figures_.back() ? 1 : 0)) + "</th>";
  }
  out_ += "</tr></thead><tbody>";
}

void HtmlTable::row(const std::vector<std::string> &cells, const char *verdict) {
  any_ = true;
  out_ += "<tr>";
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const std::string kind = std::string(figures_[i] ? "n " : "") + (i + 1 == cells.size() ? verdict : "");
    out_ += "<td class='" + kind + "'>" + base::escape(cells[i]) + "</td>";
  }
  out_ += "</tr>";
}

std::string section(std::string_view heading, const std::string &content, std::string_view kind) {
  return content.empty() ? std::string()
                         : "<section class='" + std::string(kind) + "'><h2>" + base::escape(heading) + "</h2>" +
                               content + "</section>";
}

std::string card(std::string_view name, const std::string &value, std::string_view remark) {
  return "<div class='card'><span>" + base::escape(name) + "</span><b>" + base::escape(value) + "</b><small>" +
         base::escape(remark) + "</small></div>";
}

std::string pair(const std::string &left, const std::string &right) {
  return left.empty() && right.empty() ? std::string() : "<div class='pair'>" + left + right + "</div>";
}

std::string columns(const std::string &left, const std::string &right) {
  return left.empty() && right.empty() ? std::string() : "<div class='columns'>" + left + right + "</div>";
}

std::string page(std::string_view title, const std::string &body) {
  return "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
         "<meta name='viewport' content='width=device-width,initial-scale=1'><title>" +
         base::escape(title) + "</title><style>" + kPageStyle + "</style></head><body><main>" + body +
         "</main></body></html>\n";
}

base::Result<std::string> picture_cell(const casefile::Image &image, std::string_view alternative,
                                       std::string_view caption) {
  const auto png = casefile::encode_png(image);
  if (!png) {
    return tl::unexpected(png.error());
  }
  return "<div><img alt='" + base::escape(alternative) + "' src='data:image/png;base64," + base64(*png) + "'><p>" +
         base::escape(caption) + "</p></div>";
}

std::string base64(const std::vector<std::uint8_t> &bytes) {
  static constexpr char kAlphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      group = (group << 8U) | (k < left ? bytes[i + k] : 0U);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      out += k <= left ? kAlphabet[(group >> (18U - 6U * k)) & 63U] : '=';
    }
  }
  return out;
}

} // namespace bregma::cli::report
