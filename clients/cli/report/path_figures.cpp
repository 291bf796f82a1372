#include <algorithm>
#include <cmath>

#include "base/plots.hpp"
#include "casefile/volumes/render.hpp"
#include "clients/cli/report/figure_layout.hpp"
#include "clients/cli/report/figures.hpp"
#include "clients/cli/report/page_parts.hpp"
#include "clients/cli/report/path_analysis.hpp"
#include "clients/cli/report/tip_analysis.hpp"

namespace bregma::cli::report {
namespace {

using Eigen::Vector3d;

constexpr double kPathGap_s = 0.3; // a longer gap interrupts a line
constexpr double kBead_mm = 1.5;   // distance of the tips that are drawn on the head
constexpr casefile::Colour kPathSkin{206, 201, 196};
constexpr casefile::Colour kPlan{0, 114, 178};
constexpr casefile::Colour kTip{213, 94, 0};
constexpr casefile::Colour kPathTarget{160, 20, 40};

// The samples of the trajectory that was followed for the longest time.
std::vector<const PathSample *> followed(const SessionAnalysis &session) {
  std::map<std::string, std::size_t> counts;
  for (const PathSample &sample : session.path) {
    ++counts[sample.trajectory];
  }
  const auto longest =
      std::max_element(counts.begin(), counts.end(), [](const auto &a, const auto &b) { return a.second < b.second; });
  std::vector<const PathSample *> out;
  for (const PathSample &sample : session.path) {
    if (sample.trajectory == longest->first) {
      out.push_back(&sample);
    }
  }
  return out;
}

template <class X, class Y>
base::Series path_line(const std::vector<const PathSample *> &path, const std::string &name, const char *paint, X &&x,
                       Y &&y) {
  base::Series out;
  out.name = name;
  out.colour = paint;
  std::int64_t last_ns = 0;
  for (const PathSample *sample : path) {
    if (last_ns != 0 && static_cast<double>(sample->time_ns - last_ns) * 1e-9 > kPathGap_s) {
      out.points.push_back({geometry::kUnknown, geometry::kUnknown});
    }
    last_ns = sample->time_ns;
    out.points.push_back({x(*sample), y(*sample)});
  }
  return out;
}

} // namespace

std::string deviation_figure(const SessionAnalysis &session) {
  if (session.path.empty()) {
    return {};
  }
  const auto path = followed(session);
  base::Plot plot;
  plot.title = "Lateral deviation over time";
  plot.x.label = "time, s";
  plot.y.label = "lateral deviation, mm";
  plot.y.from = 0.0;
  std::vector<double> near_target;
  for (const PathSample *sample : path) {
    near_target.push_back(sample->lateral_mm);
  }
  plot.y.to = std::max(1.0, 1.15 * distribution_of(std::move(near_target)).percentile(0.995));
  plot.series.push_back(path_line(
      path, "", base::colour::kBlue, [&](const PathSample &sample) { return session.seconds(sample.time_ns); },
      [](const PathSample &sample) { return sample.lateral_mm; }));
  return half_width(plot, "Distance of the shown tip from the planned line " + path.front()->trajectory +
                              " while it was followed, also before the entry.");
}

std::string path_figure(const SessionAnalysis &session) {
  if (session.path.empty()) {
    return {};
  }
  const auto path = followed(session);
  const casefile::Trajectory *plan = plan_of(session, path.front()->trajectory);
  base::Plot plot;
  plot.title = "Path along the plan";
  plot.x.label = "along the plan, mm (0: target)";
  plot.y.label = "beside the planned line, mm";
  const auto along = [](const PathSample &sample) { return -sample.remaining_depth_mm; };
  std::vector<double> offsets;
  if (plan != nullptr) {
    const AcrossPlan sides = across(*plan);
    for (std::size_t i = 0; i < 2; ++i) {
      const auto beside = [&, i](const PathSample &sample) {
        return (sample.tip_mm - plan->target_mm).dot(sides.directions[i]);
      };
      plot.series.push_back(path_line(path, "towards " + sides.names[i],
                                      i == 0 ? base::colour::kBlue : base::colour::kOrange, along, beside));
    }
    plot.rules.push_back(
        {base::RuleKind::kVertical, -(plan->target_mm - plan->entry_mm).norm(), "entry", base::colour::kGrey});
  } else {
    plot.series.push_back(path_line(path, "lateral deviation", base::colour::kBlue, along,
                                    [](const PathSample &sample) { return sample.lateral_mm; }));
  }
  for (const base::Series &series : plot.series) {
    for (const base::PlotPoint &point : series.points) {
      offsets.push_back(std::abs(point.y));
    }
  }
  const double reach = std::max(1.0, 1.15 * distribution_of(std::move(offsets)).percentile(0.995));
  plot.y.from = plan != nullptr ? -reach : 0.0;
  plot.y.to = reach;
  plot.rules.push_back({base::RuleKind::kHorizontal, 0.0, "plan", base::colour::kGrey});
  plot.rules.push_back({base::RuleKind::kVertical, 0.0, "target", "#374151"});
  return half_width(plot, "The shown tip beside the planned line, in two directions across it, from left to right as "
                          "it approached the target.");
}

base::Result<std::string> path_on_head_figure(const SessionAnalysis &session) {
  if (session.path.empty() || session.scalp.triangles.empty()) {
    return std::string();
  }
  const auto path = followed(session);
  const casefile::Trajectory *plan = plan_of(session, path.front()->trajectory);
  if (plan == nullptr) {
    return std::string();
  }
  casefile::Scene scene;
  scene.width = scene.height = 460;
  scene.meshes.push_back({.mesh = &session.scalp, .vertex_colours = {kPathSkin}, .opacity = 0.35});
  scene.lines.push_back({plan->entry_mm, plan->target_mm, 0.8, kPlan});
  scene.spheres.push_back({plan->target_mm, 2.5, kPathTarget});
  const double length_mm = (plan->target_mm - plan->entry_mm).norm();
  const Vector3d *last = nullptr;
  for (const PathSample *sample : path) {
    const bool near = sample->remaining_depth_mm < length_mm + 40.0;
    if (near && (last == nullptr || (sample->tip_mm - *last).norm() >= kBead_mm)) {
      scene.spheres.push_back({sample->tip_mm, 0.9, kTip});
      last = &sample->tip_mm;
    }
  }
  std::string out = "<figure><div class='heads'>";
  const AcrossPlan sides = across(*plan);
  for (std::size_t i = 0; i < 2; ++i) {
    scene.camera.towards_eye = sides.directions[i];
    // The way in points down, so that the entry is above the target.
    scene.camera.up = plan->entry_mm - plan->target_mm;
    const std::string name = "seen from " + sides.names[i];
    const auto picture = picture_cell(casefile::render(scene), "The path " + name, name);
    if (!picture) {
      return tl::unexpected(picture.error());
    }
    out += *picture;
  }
  return out + "</div><figcaption>The shown tip (orange) and the planned line (blue) with its target, in two views "
               "across the line; the entry is above.</figcaption></figure>";
}

} // namespace bregma::cli::report
