#include "clients/cli/plain_text.hpp"

#include <algorithm>
#include <cmath>

#include "clients/cli/output.hpp"

namespace bregma::cli {

std::string duration_text(double seconds) {
  if (!std::isfinite(seconds)) {
    return "-";
  }
  if (std::abs(seconds) < 0.9995) {
    return fixed(seconds * 1e3, 0, "ms");
  }
  if (std::abs(seconds) < 59.95) {
    return fixed(seconds, 1, "s");
  }
  const auto whole = std::llround(seconds);
  if (whole < 3600) {
    return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) + " s";
  }
  return std::to_string(whole / 3600) + " h " + std::to_string(whole / 60 % 60) + " min";
}

std::string printable(std::string_view text) {
  std::string out(text);
  std::replace_if(
      out.begin(), out.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20U || c == 0x7F; }, '?');
  return out;
}

} // namespace bregma::cli
