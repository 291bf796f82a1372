#include "casefile/surface_files/text_cursor.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "base/text.hpp"
#include "casefile/surface_files/mesh_arrays.hpp"

namespace bregma::casefile::detail {

namespace {

constexpr std::string_view kBlanks = " \t\r\n\v\f";
constexpr std::size_t kShownLength = 40;

} // namespace

std::string in_quotes(std::string_view word) {
  std::string out(word.substr(0, kShownLength));
  std::replace_if(
      out.begin(), out.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20U || c == 0x7F; }, '?');
  return "\"" + out + (word.size() > kShownLength ? "...\"" : "\"");
}

std::string_view TextCursor::word() {
  const std::size_t start = std::min(text_.find_first_not_of(kBlanks, at_), text_.size());
  next_line_ += static_cast<int>(std::count(text_.begin() + static_cast<std::ptrdiff_t>(at_),
                                            text_.begin() + static_cast<std::ptrdiff_t>(start), '\n'));
  line_ = next_line_;
  at_ = std::min(text_.find_first_of(kBlanks, start), text_.size());
  return text_.substr(start, at_ - start);
}

std::string_view TextCursor::rest_of_line() {
  const std::size_t start = at_;
  const std::size_t end = text_.find('\n', start);
  line_ = next_line_;
  if (end == std::string_view::npos) {
    at_ = text_.size();
    return base::trimmed(text_.substr(start));
  }
  at_ = end + 1;
  ++next_line_;
  return base::trimmed(text_.substr(start, end - start));
}

void TextCursor::skip_to(std::size_t position) { at_ = std::clamp(position, at_, text_.size()); }

Parsed<double> TextCursor::number(const std::string &what) {
  const std::string_view text = word();
  if (text.empty()) {
    return wrong_line(line_, "the file ends before " + what);
  }
  // from_chars does not accept a leading plus.
  const auto value = base::parsed_number<double>(text.front() == '+' ? text.substr(1) : text);
  if (!value || !std::isfinite(*value)) {
    return wrong_line(line_, what + " = " + in_quotes(text) + ": must be a finite number");
  }
  return *value;
}

Parsed<std::size_t> TextCursor::count(const std::string &what, std::size_t min_bytes_each) {
  const std::string_view text = word();
  const auto value = base::parsed_number<std::uint32_t>(text);
  if (!value) {
    return wrong_line(line_, what + " = " + in_quotes(text) + ": must be a whole number");
  }
  if (*value > left() / min_bytes_each) {
    return wrong_line(line_, what + " = " + std::string(text) + ": the file is too short for this number");
  }
  return *value;
}

Parsed<Eigen::Vector3d> TextCursor::point(const std::string &what) {
  Eigen::Vector3d out;
  for (int axis = 0; axis < 3; ++axis) {
    const auto value = number(what + ": " + static_cast<char>('x' + axis));
    if (!value) {
      return tl::unexpected(value.error());
    }
    out[axis] = *value;
  }
  return out;
}

Parsed<int> TextCursor::corner(const std::string &what, std::size_t vertices) {
  const std::string_view text = word();
  if (text.empty()) {
    return wrong_line(line_, "the file ends before " + what);
  }
  const auto value = base::parsed_number<std::int64_t>(text);
  if (!value || *value < 0 || *value >= static_cast<std::int64_t>(vertices)) {
    return wrong_line(line_, what + ": corner = " + in_quotes(text) + ": " + range_text(vertices));
  }
  return static_cast<int>(*value);
}

} // namespace bregma::casefile::detail
