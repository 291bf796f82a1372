#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "base/plots.hpp"
#include "casefile/volumes/render.hpp"
#include "clients/cli/report/figures.hpp"
#include "clients/cli/report/page_parts.hpp"
#include "clients/cli/report/tip_analysis.hpp"

namespace bregma::cli::report {
namespace {

using casefile::Colour;

// Blue inside, pale at zero, red outside. Both ends have the same lightness, also for colour-blind readers.
constexpr std::array<Colour, 5> kStops{{{33, 80, 168}, {96, 165, 220}, {250, 245, 215}, {240, 140, 90}, {178, 24, 43}}};
constexpr Colour kSkin{206, 201, 196};

Colour colour_of(double residual_mm, double reach_mm) {
  const double place = std::clamp(0.5 + 0.5 * residual_mm / reach_mm, 0.0, 1.0) * (kStops.size() - 1);
  const auto below = std::min(static_cast<std::size_t>(place), kStops.size() - 2);
  const double fraction = place - static_cast<double>(below);
  Colour out{};
  for (std::size_t i = 0; i < 3; ++i) {
    out[i] =
        static_cast<std::uint8_t>(std::lround((1.0 - fraction) * kStops[below][i] + fraction * kStops[below + 1][i]));
  }
  return out;
}

std::string hex(const Colour &colour) {
  char text[8];
  std::snprintf(text, sizeof(text), "#%02x%02x%02x", colour[0], colour[1], colour[2]);
  return text;
}

struct View {
  const char *name;
  Eigen::Vector3d towards_eye;
  Eigen::Vector3d up;
};

} // namespace

base::Result<std::string> head_figure(const SessionAnalysis &session) {
  if (session.scalp.triangles.empty() || session.trace.empty()) {
    return std::string();
  }
  std::vector<double> sizes;
  for (const auto &point : session.trace) {
    sizes.push_back(std::abs(point.residual_mm));
  }
  // A rounded limit that covers 98 % of the samples, so that reports can be compared.
  const double reach_mm = std::max(1.0, std::ceil(distribution_of(std::move(sizes)).percentile(0.98) * 2.0) / 2.0);

  casefile::Scene scene;
  scene.width = 460;
  scene.height = 460;
  scene.meshes.push_back({&session.scalp, {kSkin}});
  for (const auto &point : session.trace) {
    scene.spheres.push_back({point.on_scalp_mm, 2.4, colour_of(point.residual_mm, reach_mm)});
  }
  const std::array<View, 4> views{{{"from the front", Eigen::Vector3d::UnitY(), Eigen::Vector3d::UnitZ()},
                                   {"from the patient's left", -Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitZ()},
                                   {"from the patient's right", Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitZ()},
                                   {"from above, face up", Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitY()}}};
  std::string out = "<figure><div class='heads'>";
  for (const auto &view : views) {
    scene.camera.towards_eye = view.towards_eye;
    scene.camera.up = view.up;
    const auto picture = picture_cell(casefile::render(scene), std::string("The head ") + view.name, view.name);
    if (!picture) {
      return tl::unexpected(picture.error());
    }
    out += *picture;
  }
  std::vector<std::string> stops;
  stops.reserve(std::size(kStops));
  for (const auto &stop : kStops) {
    stops.push_back(hex(stop));
  }
  out += "</div><div class='bar'>" +
         base::colour_bar_svg(stops, -reach_mm, reach_mm, "signed distance to the scalp, mm (negative: inside)") +
         "</div>";
  out += "<figcaption>" + std::to_string(session.trace.size()) +
         " traced points, drawn where they meet the scalp of the case.</figcaption></figure>";
  return out;
}

} // namespace bregma::cli::report
