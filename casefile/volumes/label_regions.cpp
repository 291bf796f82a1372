#include "casefile/volumes/label_regions.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "base/read_file.hpp"
#include "base/text.hpp"
#include "base/write_file.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

// Hues a golden section apart: numbers that are close, as neighbours in the brain often are, differ most.
std::uint32_t default_colour(int number) {
  constexpr double kGolden = 0.6180339887498949;
  const double hue = std::fmod(kGolden * number, 1.0);
  const double saturation = number % 2 == 0 ? 0.55 : 0.85;
  std::uint32_t out = 0;
  for (const double shift : {1.0, 2.0 / 3.0, 1.0 / 3.0}) { // red, green, blue of a hue
    const double t = std::clamp(std::abs(std::fmod(hue + shift, 1.0) * 6.0 - 3.0) - 1.0, 0.0, 1.0);
    out = out << 8U | static_cast<std::uint32_t>(std::lround(240.0 * (1.0 - saturation * (1.0 - t))));
  }
  return out;
}

// Three whole numbers up to 255.
std::optional<std::uint32_t> colour_of(const std::array<std::string, 3> &words) {
  std::uint32_t out = 0;
  for (const std::string &word : words) {
    const auto value = base::parsed_number<unsigned>(word);
    if (!value || *value > 255) {
      return std::nullopt;
    }
    out = out << 8U | *value;
  }
  return out;
}

// After the number of a region: three numbers and then a name in quotes, or a name and then four numbers.
std::optional<std::uint32_t> stated_colour(std::string_view rest) {
  const std::size_t quote = rest.find('"');
  std::istringstream in{std::string(rest.substr(0, quote))};
  std::vector<std::string> words;
  for (std::string word; in >> word;) {
    words.push_back(word);
  }
  constexpr std::size_t kRgba = 4;
  if (quote == std::string_view::npos && words.size() <= kRgba) {
    return std::nullopt;
  }
  const std::size_t at = quote == std::string_view::npos ? words.size() - kRgba : 0;
  return words.size() < at + 3 ? std::nullopt : colour_of({words[at], words[at + 1], words[at + 2]});
}

LabelRegion region_of(int number, std::string name, const LabelColours &colours) {
  const auto colour = colours.find(number);
  return {std::move(name), colour == colours.end() ? default_colour(number) : colour->second};
}

} // namespace

LabelColours read_label_colours(const fs::path &file) {
  constexpr std::size_t kMaxBytes = std::size_t{4} << 20;
  LabelColours out;
  std::istringstream lines(base::read_file(file, kMaxBytes).value_or(""));
  for (std::string line; std::getline(lines, line);) {
    const std::string_view text = base::trimmed(line);
    const std::size_t end = std::min(text.find_first_of(" \t"), text.size());
    const auto number = base::parsed_number<int>(text.substr(0, end));
    const auto colour = number ? stated_colour(text.substr(end)) : std::nullopt;
    if (colour) {
      out.emplace(*number, *colour);
    }
  }
  return out;
}

LabelRegions regions_in(const LabelVolume &labels, const LabelNames &names, const LabelColours &colours) {
  LabelRegions out;
  std::int16_t last = 0;
  for (const std::int16_t number : labels.voxels) {
    if (number <= 0 || number == last) {
      continue;
    }
    last = number;
    if (!out.contains(number)) {
      const auto name = names.find(number);
      out[number] = region_of(number, name == names.end() ? "region " + std::to_string(number) : name->second, colours);
    }
  }
  return out;
}

base::Result<void> write_label_regions(const fs::path &file, const LabelRegions &regions) {
  std::string text = "# Regions of the label image: number, red, green, blue, opacity, visible, mesh, \"name\"\n";
  for (const auto &[number, region] : regions) {
    std::array<char, 64> head{};
    std::snprintf(head.data(), head.size(), "%5d %3u %3u %3u 1 1 1 \"", number, region.colour >> 16U & 255U,
                  region.colour >> 8U & 255U, region.colour & 255U);
    text += head.data();
    for (const char c : region.name) {
      text += std::iscntrl(static_cast<unsigned char>(c)) != 0 ? ' ' : c;
      if (c == '"') {
        text.back() = '\'';
      }
    }
    text += "\"\n";
  }
  return base::write_file(file, text);
}

base::Result<LabelRegions> read_label_regions(const fs::path &file) {
  auto names = read_label_names(file);
  if (!names) {
    return tl::unexpected(names.error());
  }
  const LabelColours colours = read_label_colours(file);
  LabelRegions out;
  for (auto &[number, name] : *names) {
    if (number > 0) {
      out[number] = region_of(number, std::move(name), colours);
    }
  }
  return out;
}

} // namespace bregma::casefile
