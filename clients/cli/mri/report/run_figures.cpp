#include "clients/cli/mri/report/run_figures.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "base/plots.hpp"
#include "clients/cli/mri/report/run_pictures.hpp"
#include "clients/cli/mri/scanner_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/report/figure_layout.hpp"
#include "clients/cli/report/page_parts.hpp"
#include "idl/names.hpp"

namespace bregma::cli::mri_report {

namespace {

using base::PlotPoint;
using report::picture_cell;

constexpr std::array kShownPlanes_mm{18.0, -89.0}; // figure 12
constexpr double kMapStep_mm = 1.0;
constexpr double kMapMargin_mm = 6.0;
constexpr int kArtefactSlices = 12; // figure 7
constexpr double kArtefactHalf_mm = 16.0;
constexpr int kEnlarged = 3; // pixels of slices in pictures with marks

// "x" for a direction near the first axis of Device.
const char *axis_name(const Vector3d &direction) {
  Eigen::Index axis = 0;
  direction.cwiseAbs().maxCoeff(&axis);
  return axis == 0 ? "x" : axis == 1 ? "y" : "z";
}

std::string in_plane_label(const char *along, const Vector3d &direction) {
  return std::string("along the ") + along + " (" + axis_name(direction) + "), mm";
}

base::Series points(std::string name, const char *colour, double radius) {
  base::Series out;
  out.name = std::move(name);
  out.colour = colour;
  out.mark = base::Mark::kPoints;
  out.size = radius;
  return out;
}

std::string square(const base::Plot &plot, std::string_view caption) {
  return report::figure(report::responsive(
                            [&](int width) {
                              return base::plot_svg(plot, {width, width - 10});
                            },
                            520, 420),
                        caption);
}

std::string grid_of(const std::string &cells, const std::string &caption) {
  return "<figure><div class='heads'>" + cells + "</div><figcaption>" + base::escape(caption) +
         "</figcaption></figure>";
}

// Appends a picture; false and the error where it cannot be encoded.
class Cells {
public:
  void add(const Image &image, std::string_view alternative, std::string_view caption) {
    if (error_.message.empty()) {
      auto cell = picture_cell(image, alternative, caption);
      cell ? void(html_ += *cell) : void(error_ = cell.error());
    }
  }
  [[nodiscard]] base::Result<std::string> figure(const std::string &caption) const {
    return error_.message.empty() ? base::Result<std::string>(grid_of(html_, caption))
                                  : base::Result<std::string>(tl::unexpected(error_));
  }

private:
  std::string html_;
  base::Error error_;
};

std::span<const float> slice_of(const Stack &stack, int k) {
  const std::size_t pixels = static_cast<std::size_t>(stack.size[0]) * static_cast<std::size_t>(stack.size[1]);
  return std::span(stack.voxels).subspan(static_cast<std::size_t>(k) * pixels, pixels);
}

Vector3d index_of(const Stack &stack, const Vector3d &p) { return stack.axes().inverse() * (p - stack.origin_mm()); }

std::vector<float> difference_of(const CoilAnalysis &coils, int k) {
  const auto background = slice_of(coils.background, k), foreground = slice_of(coils.foreground, k);
  std::vector<float> out(background.size());
  std::transform(background.begin(), background.end(), foreground.begin(), out.begin(), std::minus<>());
  return out;
}

int slice_at(const Stack &stack, const mri::CoilArtefact &artefact) {
  return std::clamp(static_cast<int>(std::lround(index_of(stack, artefact.centre_mm).z())), 0, stack.size[2] - 1);
}

} // namespace

std::string correction_figure(const PhantomAnalysis &phantom) {
  const auto worst =
      std::max_element(phantom.planes.begin(), phantom.planes.end(), [](const PhantomPlane &a, const PhantomPlane &b) {
        return a.distortion.overall.mean_mm < b.distortion.overall.mean_mm;
      });
  if (worst == phantom.planes.end() || !phantom.field) {
    return {};
  }
  const Vector3d u = phantom.axes.col(0), v = phantom.axes.col(1);
  const auto flat = [&](const Vector3d &p) { return PlotPoint{u.dot(p), v.dot(p)}; };
  base::Plot before, after;
  before.title = "Crossings of one plane of the phantom in CT and MR";
  after.title = "Crossings of one plane of the phantom in CT and corrected";
  before.x.label = after.x.label = in_plane_label("rows", u);
  before.y.label = after.y.label = in_plane_label("columns", v);
  base::Series real = points("in CT", base::colour::kBlue, 3.0), shown = points("in MR", base::colour::kOrange, 2.2),
               corrected = points("corrected", base::colour::kOrange, 1.6), moves;
  moves.colour = base::colour::kGrey;
  moves.size = 1.2;
  for (const Eigen::Index i : worst->points) {
    const Vector3d p = phantom.true_mm.col(i), q = phantom.imaged_mm.col(i);
    real.points.push_back(flat(p));
    shown.points.push_back(flat(q));
    moves.points.insert(moves.points.end(), {flat(p), flat(q), {std::nan(""), std::nan("")}});
    if (const auto back = phantom.field->to_true(q)) {
      corrected.points.push_back(flat(*back));
    }
  }
  before.series = {real, moves, shown};
  after.series = {real, corrected};
  return report::pair(
      square(before, "The plane with the largest mean distortion, " + fixed(worst->at_mm, 0, "mm") +
                         " from the isocentre: mean " + fixed(worst->distortion.overall.mean_mm, 2, "mm") +
                         ", largest " + fixed(worst->distortion.overall.max_mm, 2, "mm") + "."),
      square(after, "The same crossings after correction by the field through all of them. At crossings "
                    "that took no part in a field the residual is " +
                        fixed(phantom.after.overall.mean_mm, 2, "mm") + " in the mean, " +
                        fixed(phantom.after.overall.max_mm, 2, "mm") + " at most."));
}

base::Result<std::string> steps_figure(const PhantomAnalysis &phantom) {
  if (phantom.stages.empty()) {
    return std::string();
  }
  constexpr std::array kLetters{"a", "b", "c", "d", "e", "f", "g", "h"};
  Cells cells;
  for (std::size_t i = 0; i < phantom.stages.size() && i < kLetters.size() - 1; ++i) {
    const mri::CrossingStage &stage = phantom.stages[i];
    cells.add(grey(stage.pixels, stage.columns, stage.rows), stage.name,
              std::string("(") + kLetters[i] + ") " + stage.name);
  }
  const mri::CrossingStage &original = phantom.stages.front();
  Image marked = grey(original.pixels, original.columns, original.rows);
  for (const Eigen::Vector2d &p : phantom.crossings) {
    for (const int off : {0, 1}) {
      draw_cross(marked, p + Eigen::Vector2d::Constant(off), 5, kMarkOrange);
    }
  }
  cells.add(marked, "centroids on the original", "(h) " + std::to_string(phantom.crossings.size()) + " centroids");
  return cells.figure(
      "Search for crossings in the slice at " + fixed(phantom.slice_mm, 1, "mm") +
      " from the isocentre. What follows is not shown: averaging over slices, sub-voxel position, lattice.");
}

base::Result<std::string> subtraction_figure(const CoilAnalysis &coils) {
  if (coils.search.artefacts.empty()) {
    return std::string();
  }
  const Stack &stack = coils.background;
  const int k = slice_at(stack, coils.search.artefacts.front());
  const auto bright = static_cast<float>(1.15 * coils.search.signal);
  const std::vector<float> difference = difference_of(coils, k);
  const auto picture = [&](std::span<const float> values, int times) {
    return grey(values, stack.size[0], stack.size[1], 0.0F, bright, times);
  };
  Image marked = picture(difference, kEnlarged);
  int shown = 0;
  for (const mri::CoilArtefact &artefact : coils.search.artefacts) {
    const Vector3d index = index_of(stack, artefact.centre_mm);
    if (std::abs(index.z() - k) * stack.spacing_mm().z() > 6.0) {
      continue;
    }
    const Eigen::Vector2d centre = (index.head<2>().array() + 0.5) * kEnlarged - 0.5;
    const double radius = std::sqrt(artefact.area_mm2 / M_PI) / stack.spacing_mm().x() * kEnlarged;
    draw_circle(marked, centre, radius, kMarkOrange);
    draw_cross(marked, centre, 4, kMarkOrange);
    ++shown;
  }
  Cells cells;
  cells.add(picture(slice_of(coils.foreground, k), 1), "foreground", "foreground, coils on");
  cells.add(picture(slice_of(coils.background, k), 1), "background", "background, coils off");
  cells.add(picture(difference, 1), "difference", "background minus foreground");
  cells.add(marked, "coils found", "coils found");
  return cells.figure("Slice " + std::to_string(k + 1) + " of " + std::to_string(stack.size[2]) + " of the scan \"" +
                      coils.protocol + "\". Circles have the area of the artefact in its largest slice; " +
                      std::to_string(shown) + " of the " + std::to_string(coils.search.artefacts.size()) +
                      " artefacts have their centre within 6 mm of this slice.");
}

base::Result<std::string> artefact_figure(const CoilAnalysis &coils) {
  if (coils.search.artefacts.empty()) {
    return std::string();
  }
  const Stack &stack = coils.background;
  const Vector3d index = index_of(stack, coils.search.artefacts.front().centre_mm);
  const int half = static_cast<int>(std::lround(kArtefactHalf_mm / stack.spacing_mm().x()));
  const int middle = static_cast<int>(std::lround(index.z()));
  const int first = std::clamp(middle - kArtefactSlices / 2, 0, std::max(0, stack.size[2] - kArtefactSlices));
  Cells cells;
  for (int k = first; k < std::min(first + kArtefactSlices, stack.size[2]); ++k) {
    const Image whole =
        grey(difference_of(coils, k), stack.size[0], stack.size[1], 0.0F, static_cast<float>(coils.search.signal), 4);
    const Vector3d p = stack.point_mm(Vector3d(index.x(), index.y(), k));
    const auto corner = [&](double at) { return 4 * (static_cast<int>(std::lround(at)) - half); };
    cells.add(cropped(whole, corner(index.x()), corner(index.y()), 8 * half, 8 * half), "artefact",
              "slice " + std::to_string(k + 1) + ", " +
                  fixed((p - coils.search.artefacts.front().centre_mm).dot(stack.axes().col(2).normalized()), 1) +
                  " mm");
  }
  return cells.figure("The artefact of one coil of \"" + coils.protocol + "\" in consecutive slices (" +
                      fixed(2.0 * kArtefactHalf_mm, 0) + " mm wide), and their distance from its centre.");
}

std::string plane_figure(const PhantomAnalysis &phantom) {
  if (phantom.planes.empty()) {
    return {};
  }
  std::string out;
  std::vector<std::string> figures;
  for (const bool largest : {false, true}) {
    base::Plot plot;
    plot.title = largest ? "Largest distortion of each plane" : "Mean distortion of each plane";
    plot.x.label = std::string("plane, along the slices' normal (") + axis_name(phantom.axes.col(2)) + "), mm";
    plot.y.label = largest ? "largest distortion, mm" : "mean distortion, mm";
    plot.y.from = 0.0;
    const std::array colours{base::colour::kBlue, base::colour::kOrange, base::colour::kGreen, base::colour::kPurple};
    for (std::size_t a = 0; a < 4; ++a) {
      base::Series line;
      line.name = a < 3 ? std::string("along ") + "xyz"[a] : "overall";
      line.colour = colours[a];
      line.size = a < 3 ? 1.5 : 2.4;
      for (const PhantomPlane &plane : phantom.planes) {
        const mri::ErrorSummary::Row &row = a < 3 ? plane.distortion.axis[a] : plane.distortion.overall;
        line.points.push_back({plane.at_mm, largest ? row.max_mm : row.mean_mm});
      }
      plot.series.push_back(std::move(line));
    }
    figures.push_back(report::half_width(plot, largest ? "(b) Largest absolute distortion of each plane of crossings."
                                                       : "(a) Mean absolute distortion, before correction."));
  }
  return report::pair(figures[0], figures[1]);
}

base::Result<std::string> map_figure(const PhantomAnalysis &phantom) {
  if (!phantom.field || phantom.true_mm.cols() == 0) {
    return std::string();
  }
  const Vector3d u = phantom.axes.col(0), v = phantom.axes.col(1), n = phantom.axes.col(2);
  const auto range = [&](const Vector3d &d) {
    const Eigen::RowVectorXd along = d.transpose() * phantom.true_mm;
    return std::pair(along.minCoeff() - kMapMargin_mm, along.maxCoeff() + kMapMargin_mm);
  };
  const auto [u0, u1] = range(u);
  const auto [v0, v1] = range(v);
  const ColourMap map{0.0, std::max(1.0, std::ceil(2.0 * phantom.before.overall.max_mm) / 2.0)};
  const double half_range = phantom.field->spacing_mm();
  Cells cells;
  for (const double at : kShownPlanes_mm) {
    const Image picture = coloured(static_cast<int>((u1 - u0) / kMapStep_mm), static_cast<int>((v1 - v0) / kMapStep_mm),
                                   map, [&, u0 = u0, v0 = v0](int column, int row) -> std::optional<double> {
                                     const Vector3d p =
                                         (u0 + column * kMapStep_mm) * u + (v0 + row * kMapStep_mm) * v + at * n;
                                     const auto known = phantom.field->assess(p);
                                     if (known.coverage == mri::Coverage::kUnknown || known.distance_mm > half_range) {
                                       return std::nullopt;
                                     }
                                     return (phantom.field->to_imaged(p) - p).norm();
                                   });
    cells.add(picture, "distortion map", "plane at " + fixed(at, 0, "mm"));
  }
  auto figure = cells.figure("Distortion in two planes perpendicular to the slices' normal, as the field has it. Grey: "
                             "more than a cell outside the phantom, or not known.");
  if (figure) {
    *figure +=
        "<div class='bar'>" + base::colour_bar_svg(ColourMap::stops(), map.low, map.high, "distortion, mm") + "</div>";
  }
  return figure;
}

std::string coil_plan_figure(const PhantomAnalysis &phantom, const RunRecord &record) {
  if (!record.state() || record.state()->coil_count == 0) {
    return {};
  }
  const Vector3d u = phantom.axes.col(0), v = phantom.axes.col(1);
  const auto flat = [&](const Vector3d &p) { return PlotPoint{u.dot(p), v.dot(p)}; };
  base::Plot plot;
  plot.title = "Control points and coils, seen along the slices' normal";
  plot.x.label = in_plane_label("rows", u);
  plot.y.label = in_plane_label("columns", v);
  base::Series crossings = points("control points as imaged", base::colour::kGrey, 1.0),
               used = points("coils that register", base::colour::kBlue, 4.0),
               verify = points("coils that verify", base::colour::kOrange, 4.0);
  for (Eigen::Index i = 0; i < phantom.imaged_mm.cols(); ++i) {
    crossings.points.push_back(flat(phantom.imaged_mm.col(i)));
  }
  const wire::ScannerRegistration &state = *record.state();
  for (std::uint32_t i = 0; i < state.coil_count && i < bregma_wire_MAX_COILS; ++i) {
    const wire::CoilReport &coil = state.coils[i];
    if (coil.outcome == bregma_wire_COIL_USED || coil.outcome == bregma_wire_COIL_VERIFIES) {
      (coil.outcome == bregma_wire_COIL_USED ? used : verify).points.push_back(flat(Vector3d::Map(coil.scanner_mm)));
    }
  }
  plot.series = {crossings, used, verify};
  return square(plot, "Planar view, all planes on each other: " + std::to_string(used.points.size()) +
                          " coils took part in the registration, " + std::to_string(verify.points.size()) +
                          " verify it.");
}

base::Result<std::string> tip_figure(const RunRecord &record) {
  const CorrectedPicture *best = nullptr;
  for (const CorrectedPicture &picture : record.corrected()) {
    const double distance = std::abs(picture.said.tip_distance_mm);
    if (picture.said.tip_status == bregma_wire_POSE_LIVE &&
        (best == nullptr || distance < std::abs(best->said.tip_distance_mm))) {
      best = &picture;
    }
  }
  if (best == nullptr) {
    return std::string();
  }
  const wire::ImageSlice &slice = best->said.slice;
  const auto columns = static_cast<int>(slice.columns), rows = static_cast<int>(slice.rows);
  const std::vector<float> corrected(best->pixels.begin(), best->pixels.end());
  std::vector<float> sorted = corrected;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() * 95 / 100),
                   sorted.end());
  const float high = 1.1F * std::max(1.0F, sorted[sorted.size() * 95 / 100]);
  Cells cells;
  for (const ReceivedSeries &series : record.series()) {
    if (series.header.series == slice.series && slice.index <= series.slices.size() &&
        series.slices[slice.index - 1].size() == corrected.size()) {
      const auto &pixels = series.slices[slice.index - 1];
      const std::vector<float> acquired(pixels.begin(), pixels.end());
      cells.add(grey(acquired, columns, rows, 0.0F, high), "as acquired", "as acquired");
      cells.add(grey(corrected, columns, rows, 0.0F, high), "corrected", "corrected");
      std::vector<float> change(acquired.size());
      std::transform(corrected.begin(), corrected.end(), acquired.begin(), change.begin(),
                     [](float a, float b) { return std::abs(a - b); });
      cells.add(grey(change, columns, rows, 0.0F, high), "change", "what the correction changed");
      break;
    }
  }
  Image marked = grey(corrected, columns, rows, 0.0F, high, kEnlarged);
  const Eigen::Vector2d tip(best->said.tip_pixel[0], best->said.tip_pixel[1]);
  const Eigen::Vector2d at = (tip.array() + 0.5) * kEnlarged - 0.5;
  const double circle = std::max(3.0, best->said.tip_error_95_mm / slice.spacing_mm[0]) * kEnlarged;
  draw_circle(marked, at, circle, kMarkOrange);
  draw_cross(marked, at, 8, kMarkOrange);
  cells.add(marked, "tip of the tool", "with the tip of " + wire::text(best->said.tip_tool));
  return cells.figure("Slice " + std::to_string(slice.index) + " of " + std::to_string(slice.count) + " of series " +
                      std::to_string(slice.series) + ": largest shift " + fixed(best->said.max_shift_mm, 2, "mm") +
                      ", " + fixed(100.0 * best->said.missing_fraction, 1) +
                      " % of the pixels without their neighbouring slices. The tip is " +
                      fixed(best->said.tip_distance_mm, 2, "mm") + " from the plane, its stated error " +
                      fixed(best->said.tip_error_95_mm, 2, "mm") + " (95 %).");
}

std::string procedure_figure(const RunRecord &record) {
  const auto &moments = record.moments();
  if (moments.size() < 2) {
    return {};
  }
  const std::int64_t start = moments.front().time_ns;
  const auto seconds = [start](std::int64_t ns) { return 1e-9 * static_cast<double>(ns - start); };
  const double end = record.state() ? seconds(record.state()->time_ns) : seconds(moments.back().time_ns);
  const std::array<const char *, 7> colours{
      "#d7dce3", "#d7dce3", "#f1e3b0", base::colour::kOrange, base::colour::kSky, base::colour::kGreen, "#b3261e"};
  base::TimelineRow steps{"step", {}}, activities{"activity", {}};
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const ProcedureMoment &moment = moments[i];
    const double from = seconds(moment.time_ns), to = i + 1 < moments.size() ? seconds(moments[i + 1].time_ns) : end;
    const std::string step(scanner_step_label(moment.step));
    if (!steps.spans.empty() && steps.spans.back().label == step) {
      steps.spans.back().to = to;
    } else {
      steps.spans.push_back({from, to, steps.spans.size() % 2 == 0 ? "#5b7fa3" : "#7f9cb8", step});
    }
    const auto kind = static_cast<std::size_t>(std::clamp<std::int32_t>(moment.activity, 0, 6));
    activities.spans.push_back({from, to, colours[kind], std::string(scanner_activity_label(moment.activity))});
  }
  base::Axis axis;
  axis.label = "time, s";
  axis.from = 0.0;
  axis.to = end;
  return report::figure(
      report::responsive(
          [&](int width) {
            return base::timeline_svg({steps, activities}, axis, width);
          },
          1060, 420),
      "Steps of the procedure and what the daemon did. The simulated scanner sends slices faster than a real one.");
}

} // namespace bregma::cli::mri_report
