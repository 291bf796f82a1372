// `bregma register curves`: registers landmarks and curves of two images, or of two people, by a thin-plate spline. The
// spline is three-dimensional, or two-dimensional if all points of a side have the same z.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/registration/splines/curves.hpp"
#include "algorithms/registration/splines/thin_plate_spline.hpp"
#include "casefile/markups.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/registration/image_warp.hpp"
#include "clients/cli/registration/point_pairs.hpp"
#include "clients/cli/registration/register_commands.hpp"
#include "clients/cli/registration/registration_output.hpp"

namespace bregma::cli {

namespace {

using base::Result;
using casefile::MarkedCurve;
using geometry::Points3;
using nlohmann::json;
template <int D> using Spline = registration::ThinPlateSpline<D>;

struct CurvesArguments {
  std::string source, target;               // curves
  std::string source_points, target_points; // landmarks
  std::string source_image, target_image;
  std::string warped; // path of the warped image to write
  std::string kernel; // empty: the default of the dimension
  double regularisation = 0.0;
  int count = 20;
};

// The target is the reference and the source is the floating image: the spline maps in the direction of resampling.
struct Pairs {
  std::vector<std::string> notes;
  registration::PointSets<3> landmarks{Points3(3, 0), Points3(3, 0)};
  std::vector<std::string> landmark_names;
  std::vector<registration::CurvePair<3>> curves;
  std::vector<std::string> curve_names;
};

Points3 columns_of(const std::vector<Eigen::Vector3d> &points) {
  Points3 out(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    out.col(static_cast<Eigen::Index>(i)) = points[i];
  }
  return out;
}

Result<void> pair_curves(const CurvesArguments &arguments, Pairs &out) {
  const auto source = casefile::read_curves(arguments.source, &out.notes);
  if (!source) {
    return tl::unexpected(source.error());
  }
  const auto target = casefile::read_curves(arguments.target, &out.notes);
  if (!target) {
    return tl::unexpected(target.error());
  }
  if (source->size() != target->size()) {
    return base::failure(arguments.source + " has " + std::to_string(source->size()) + " curves, " + arguments.target +
                         " has " + std::to_string(target->size()) + ": they must be pairs");
  }
  for (const MarkedCurve &curve : *source) {
    const auto other =
        std::find_if(target->begin(), target->end(), [&curve](const MarkedCurve &c) { return c.name == curve.name; });
    if (other == target->end()) {
      return base::failure(arguments.target + ": has no curve \"" + curve.name + "\"");
    }
    if (other->closed != curve.closed) {
      return base::failure("curve \"" + curve.name + "\" is closed in one file and open in the other");
    }
    out.curves.push_back({columns_of(other->points_mm), columns_of(curve.points_mm), arguments.count, curve.closed});
    out.curve_names.push_back(curve.name);
  }
  return {};
}

Result<void> pair_landmarks(const CurvesArguments &arguments, Pairs &out) {
  if (arguments.source_points.empty()) {
    return {};
  }
  const auto source = read_point_file(arguments.source_points);
  if (!source) {
    return tl::unexpected(source.error());
  }
  const auto target = read_point_file(arguments.target_points);
  if (!target) {
    return tl::unexpected(target.error());
  }
  const auto pairing = pair_points({arguments.source_points, &*source}, {arguments.target_points, &*target}, false);
  if (!pairing) {
    return tl::unexpected(pairing.error());
  }
  out.notes = joined({out.notes, source->notes, target->notes, pairing->notes});
  std::vector<Eigen::Vector3d> reference;
  std::vector<Eigen::Vector3d> floating;
  for (const Pairing::Pair &pair : pairing->pairs) {
    floating.push_back(source->points[pair.source].position_mm);
    reference.push_back(target->points[pair.target].position_mm);
    out.landmark_names.push_back(pair.name);
  }
  out.landmarks = {columns_of(reference), columns_of(floating)};
  return {};
}

// RMS distance of a curve under the rigid pose of what is paired; one direction of the curve may be exchanged.
double rms_of(const Pairs &pairs, std::size_t curve, bool reversed) {
  using registration::Vector3d;
  std::vector<Vector3d> from;
  std::vector<Vector3d> to;
  const auto add = [&](const Points3 &reference, const Points3 &floating, bool backwards) {
    for (Eigen::Index i = 0; i < reference.cols(); ++i) {
      from.emplace_back(reference.col(i));
      to.emplace_back(floating.col(backwards ? floating.cols() - 1 - i : i));
    }
  };
  add(pairs.landmarks.reference_mm, pairs.landmarks.floating_mm, false);
  std::size_t begin = 0;
  std::size_t end = 0;
  for (std::size_t i = 0; i < pairs.curves.size(); ++i) {
    const auto &pair = pairs.curves[i];
    begin = i == curve ? from.size() : begin;
    const auto reference = registration::subdivide<3>(pair.reference_mm, pair.count, pair.closed);
    const auto floating = registration::subdivide<3>(pair.floating_mm, pair.count, pair.closed);
    if (reference && floating) { // else the fit says why
      add(*reference, *floating, i == curve && reversed);
    }
    end = i == curve ? from.size() : end;
  }
  const auto T = registration::fit_rigid(from, to);
  if (!T || begin == end) {
    return geometry::kUnknown;
  }
  double squares = 0.0;
  for (std::size_t i = begin; i < end; ++i) {
    squares += (*T * from[i] - to[i]).squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(end - begin));
}

// Curves of which one list goes the other way: reversed they fit several times as well. Empty: none.
std::string reversed_curves(const Pairs &pairs) {
  constexpr double kClearly = 3.0;
  std::string out;
  for (std::size_t i = 0; i < pairs.curves.size(); ++i) {
    const double as_marked = rms_of(pairs, i, false);
    const double reversed = rms_of(pairs, i, true);
    if (!pairs.curves[i].closed && as_marked > kClearly * reversed) {
      out += (out.empty() ? "" : "; ") + ("curve \"" + printable(pairs.curve_names[i])) +
             "\" is marked in the other direction: " + fixed(as_marked, 1, "mm") + " apart (RMS, rigid), reversed " +
             fixed(reversed, 1, "mm");
    }
  }
  return out;
}

struct SampledPairs {
  std::vector<registration::Vector3d> from, to; // landmarks, then the points of the curves
};
// order: the floating curve of each reference curve.
SampledPairs sampled(const Pairs &pairs, const std::vector<std::size_t> &order) {
  SampledPairs out;
  const auto add = [&out](const Points3 &reference, const Points3 &floating) {
    for (Eigen::Index i = 0; i < std::min(reference.cols(), floating.cols()); ++i) {
      out.from.emplace_back(reference.col(i));
      out.to.emplace_back(floating.col(i));
    }
  };
  add(pairs.landmarks.reference_mm, pairs.landmarks.floating_mm);
  for (std::size_t i = 0; i < pairs.curves.size(); ++i) {
    const auto &one = pairs.curves[i];
    const auto reference = registration::subdivide<3>(one.reference_mm, one.count, one.closed);
    const auto floating = registration::subdivide<3>(pairs.curves[order[i]].floating_mm, one.count, one.closed);
    if (reference && floating) { // else the fit says why
      add(*reference, *floating);
    }
  }
  return out;
}

double rigid_rms(const SampledPairs &points) {
  const auto T = registration::fit_rigid(points.from, points.to);
  double squares = 0.0;
  for (std::size_t i = 0; T && i < points.from.size(); ++i) {
    squares += (*T * points.from[i] - points.to[i]).squaredNorm();
  }
  return T ? std::sqrt(squares / static_cast<double>(points.from.size())) : geometry::kUnknown;
}

// A spline fits anything. Sides of different units, mirrored ones and exchanged curves fit each other several times as
// well otherwise. Empty: none.
std::string unlike_sides(const Pairs &pairs) {
  constexpr double kClearly = 3.0;
  constexpr double kMostScale = 1.25; // of brains and of scanners
  std::vector<std::size_t> order(pairs.curves.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const SampledPairs as_marked = sampled(pairs, order);
  const double rms = rigid_rms(as_marked);
  constexpr double kPlacement_mm = 3.0; // people mark as well
  if (!(rms > kPlacement_mm)) {
    return {};
  }
  std::string out;
  const auto say = [&](const std::string &what, double then_mm) {
    out += (out.empty() ? "" : "; ") + what + " (" + fixed(rms, 1, "mm") + " apart as given, RMS, rigid; then " +
           fixed(then_mm, 1, "mm") + ")";
  };
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (std::size_t j = i + 1; j < order.size(); ++j) {
      std::swap(order[i], order[j]);
      if (const double then = rigid_rms(sampled(pairs, order));
          pairs.curves[i].closed == pairs.curves[j].closed && rms > kClearly * then) {
        say("the curves \"" + printable(pairs.curve_names[i]) + "\" and \"" + printable(pairs.curve_names[j]) +
                "\" are exchanged",
            then);
      }
      std::swap(order[i], order[j]);
    }
  }
  SampledPairs mirrored = as_marked;
  for (registration::Vector3d &point : mirrored.from) {
    point.x() = -point.x();
  }
  if (const double then = rigid_rms(mirrored); rms > kClearly * then) {
    say("one side is the mirror image of the other", then);
  }
  const double scale = registration::spread_mm(as_marked.to).norm() / registration::spread_mm(as_marked.from).norm();
  SampledPairs scaled = as_marked;
  for (registration::Vector3d &point : scaled.from) {
    point *= scale;
  }
  if (const double then = rigid_rms(scaled);
      rms > kClearly * then && (scale > kMostScale || scale < 1.0 / kMostScale)) {
    say("the lengths of the source are " + fixed(scale, 3) + " times those of the target, are both in mm?", then);
  }
  return out;
}

// Landmarks on slices: all points of a side have the same z.
bool lies_in_plane(const Pairs &pairs) {
  using Pair = registration::CurvePair<3>;
  const auto flat = [&pairs](Points3 Pair::*side, const Points3 &landmarks) {
    const double z = (pairs.curves.front().*side)(2, 0);
    const auto level = [z](const Points3 &points) {
      return points.cols() == 0 || (points.row(2).array() - z).abs().maxCoeff() < 1e-6;
    };
    return level(landmarks) &&
           std::all_of(pairs.curves.begin(), pairs.curves.end(), [&](const Pair &pair) { return level(pair.*side); });
  };
  return flat(&Pair::reference_mm, pairs.landmarks.reference_mm) &&
         flat(&Pair::floating_mm, pairs.landmarks.floating_mm);
}

template <int D> registration::PointSets<D> landmarks_of(const Pairs &pairs) {
  return {pairs.landmarks.reference_mm.topRows<D>(), pairs.landmarks.floating_mm.topRows<D>()};
}

template <int D> std::vector<registration::CurvePair<D>> curves_of(const Pairs &pairs) {
  std::vector<registration::CurvePair<D>> out;
  for (const auto &pair : pairs.curves) {
    out.push_back({pair.reference_mm.topRows<D>(), pair.floating_mm.topRows<D>(), pair.count, pair.closed});
  }
  return out;
}

template <int D> std::string kernel_name(const CurvesArguments &arguments) {
  return !arguments.kernel.empty() ? arguments.kernel : D == 2 ? "r2logr" : "r";
}

template <int D> registration::SplineOptions spline_options(const CurvesArguments &arguments, bool leave_one_out) {
  return {kernel_name<D>(arguments) == "r" ? registration::SplineKernel::kR : registration::SplineKernel::kR2LogR,
          arguments.regularisation, leave_one_out};
}

double rms(const Eigen::VectorXd &distances) {
  return distances.size() == 0 ? geometry::kUnknown
                               : std::sqrt(distances.squaredNorm() / static_cast<double>(distances.size()));
}

// Error of a curve's points when the curve is left out; NaN if the other points determine no spline.
template <int D> double held_out_rms(const Pairs &pairs, std::size_t left_out, const CurvesArguments &arguments) {
  const auto curves = curves_of<D>(pairs);
  auto others = curves;
  others.erase(others.begin() + static_cast<std::ptrdiff_t>(left_out));
  const registration::PointSets<D> none{geometry::Points<D>(D, 0), geometry::Points<D>(D, 0)};
  const auto sets = registration::join<D>(landmarks_of<D>(pairs), others);
  const auto alone = registration::join<D>(none, std::span(&curves[left_out], 1));
  if (!sets || !alone) {
    return geometry::kUnknown;
  }
  const auto spline = Spline<D>::fit(sets->reference_mm, sets->floating_mm, spline_options<D>(arguments, false));
  return spline ? rms((spline->map(alone->reference_mm) - alone->floating_mm).colwise().norm()) : geometry::kUnknown;
}

struct HeldOut {
  double landmarks_rms_mm = 0.0, landmarks_worst_mm = 0.0;
  std::vector<double> curves_rms_mm;
};

struct Fitted { // in any dimension
  int dimensions = 3;
  std::string kernel;
  Eigen::Index centres = 0;
  HeldOut held_out;
  double time_ms = 0.0;
};

json to_json(const CurvesArguments &arguments, const Pairs &pairs, const Fitted &fitted,
             const std::optional<WarpedImage> &warped) {
  json curves = json::array();
  for (std::size_t i = 0; i < pairs.curves.size(); ++i) {
    curves.push_back({{"curve", pairs.curve_names[i]},
                      {"source_length_mm", registration::arc_length_mm(pairs.curves[i].floating_mm)},
                      {"target_length_mm", registration::arc_length_mm(pairs.curves[i].reference_mm)},
                      {"held_out_rms_mm", json_number(fitted.held_out.curves_rms_mm[i])}});
  }
  json out = {{"accepted", true},
              {"verdict", "found"},
              {"notes", pairs.notes},
              {"frames", {{"source", arguments.source}, {"target", arguments.target}, {"axes", "RAS"}, {"unit", "mm"}}},
              {"spline_from", "target"},
              {"spline_to", "source"},
              {"dimensions", fitted.dimensions},
              {"kernel", fitted.kernel},
              {"centres", fitted.centres},
              {"landmarks", pairs.landmark_names.size()},
              {"landmarks_held_out_rms_mm", json_number(fitted.held_out.landmarks_rms_mm)},
              {"landmarks_held_out_worst_mm", json_number(fitted.held_out.landmarks_worst_mm)},
              {"curves", std::move(curves)},
              {"time_ms", fitted.time_ms}};
  if (warped) {
    out["image"] = {{"rmse_before", json_number(warped->before.rmse)},
                    {"rmse_after", json_number(warped->after.rmse)},
                    {"mutual_information_before", json_number(warped->before.mutual_information)},
                    {"mutual_information_after", json_number(warped->after.mutual_information)},
                    {"grid_error_mm", warped->grid_error_mm}};
  }
  return out;
}

std::string to_text(const Pairs &pairs, const Fitted &fitted, const std::optional<WarpedImage> &warped) {
  Table table({"Held out", "Source length mm", "Target length mm", "RMS mm"});
  if (!pairs.landmark_names.empty()) {
    table.row({"each landmark", "-", "-", fixed(fitted.held_out.landmarks_rms_mm, 3)});
  }
  for (std::size_t i = 0; i < pairs.curves.size(); ++i) {
    table.row({printable(pairs.curve_names[i]), fixed(registration::arc_length_mm(pairs.curves[i].floating_mm), 1),
               fixed(registration::arc_length_mm(pairs.curves[i].reference_mm), 1),
               fixed(fitted.held_out.curves_rms_mm[i], 3)});
  }
  std::string out = "Thin-plate spline " + std::string(fitted.dimensions == 2 ? "in the plane " : "") + "through " +
                    std::to_string(fitted.centres) + " points: " + std::to_string(pairs.landmark_names.size()) +
                    " landmarks and " + std::to_string(pairs.curves.size()) + " curves, in " +
                    fixed(fitted.time_ms, 0, "ms") + "\n\n" + table.text();
  if (warped) {
    Table images({"", "RMSE", "Mutual information"});
    images.row({"before", fixed(warped->before.rmse, 3), fixed(warped->before.mutual_information, 4)});
    images.row({"after", fixed(warped->after.rmse, 3), fixed(warped->after.mutual_information, 4)});
    out += "\n" + images.text();
  }
  return out;
}

template <int D> HeldOut hold_out(const CurvesArguments &arguments, const Pairs &pairs, const Spline<D> &spline) {
  HeldOut out;
  const auto landmarks = static_cast<Eigen::Index>(pairs.landmark_names.size()); // landmarks are the first rows
  const Eigen::VectorXd of_landmarks = spline.leave_one_out_mm().head(std::min(landmarks, spline.size()));
  out.landmarks_rms_mm = rms(of_landmarks);
  out.landmarks_worst_mm = of_landmarks.size() == 0 ? geometry::kUnknown : of_landmarks.maxCoeff();
  for (std::size_t i = 0; i < pairs.curves.size(); ++i) {
    out.curves_rms_mm.push_back(held_out_rms<D>(pairs, i, arguments));
  }
  return out;
}

template <int D> int register_in(const CurvesArguments &arguments, const Pairs &pairs, const Context &context) {
  const auto sets = registration::join<D>(landmarks_of<D>(pairs), curves_of<D>(pairs));
  if (!sets) {
    return fail(sets.error());
  }
  const auto before = std::chrono::steady_clock::now();
  const auto spline = Spline<D>::fit(sets->reference_mm, sets->floating_mm, spline_options<D>(arguments, true));
  const double time_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - before).count();
  if (!spline) {
    return refuse("refused", spline.error(), context);
  }
  const Fitted fitted{D, kernel_name<D>(arguments), spline->size(), hold_out<D>(arguments, pairs, *spline), time_ms};
  std::optional<WarpedImage> warped;
  if constexpr (D == 3) {
    if (!arguments.source_image.empty()) {
      std::vector<std::string> notes;
      auto image = warp_image(arguments.source_image, arguments.target_image, *spline, notes);
      print_notes(notes);
      if (!image) {
        return fail(image.error());
      }
      warped = std::move(*image);
    }
  }
  if (context.json) {
    print_json(to_json(arguments, pairs, fitted, warped));
  } else {
    print(to_text(pairs, fitted, warped));
  }
  if (warped && !arguments.warped.empty()) {
    const auto written = casefile::write_volume(arguments.warped, warped->image);
    return written ? static_cast<int>(kOk) : fail(written.error());
  }
  return kOk;
}

int register_curves(const CurvesArguments &arguments, const Context &context) {
  if (arguments.source_points.empty() != arguments.target_points.empty()) {
    return fail("--source-points and --target-points go together");
  }
  if (auto kept = check_output("--warped", arguments.warped,
                               {arguments.source, arguments.target, arguments.source_points, arguments.target_points,
                                arguments.source_image, arguments.target_image});
      !kept) {
    return fail(kept.error());
  }
  if (arguments.source_image.empty() != arguments.target_image.empty() ||
      (!arguments.warped.empty() && arguments.source_image.empty())) {
    return fail("--source-image and --target-image go together, and --warped needs them");
  }
  Pairs pairs;
  for (const auto read : {pair_curves, pair_landmarks}) {
    if (const auto done = read(arguments, pairs); !done) {
      return fail(done.error());
    }
  }
  if (!context.json) {
    print_notes(pairs.notes);
  }
  if (const std::string reversed = reversed_curves(pairs); !reversed.empty()) {
    return refuse("refused", reversed, context, {{"notes", pairs.notes}});
  }
  if (const std::string unlike = unlike_sides(pairs); !unlike.empty()) {
    return refuse("refused", unlike, context, {{"notes", pairs.notes}});
  }
  if (!lies_in_plane(pairs)) {
    return register_in<3>(arguments, pairs, context);
  }
  return arguments.source_image.empty()
             ? register_in<2>(arguments, pairs, context)
             : fail("all points of a side have the same z: they define a warp in the plane, but not of a 3-D image");
}

} // namespace

void add_register_curves(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("curves", "Registers landmarks and curves, by a thin-plate spline");
  auto a = std::make_shared<CurvesArguments>();
  command->add_option("source", a->source, "Curves to map: .mrk.json (Curve, ClosedCurve, Line) or .csv (curve,x,y,z)")
      ->required();
  command
      ->add_option("target", a->target, "The same curves in the target; paired by name, marked in the same direction")
      ->required();
  command->add_option("--source-points", a->source_points,
                      "Landmarks in addition to the curves: .csv, .mrk.json or .fcsv");
  command->add_option("--target-points", a->target_points, "The same landmarks in the target; paired by name");
  command->add_option("--source-image", a->source_image, "The image of the source, to be warped");
  command->add_option("--target-image", a->target_image, "The image of the target, to compare it with");
  command->add_option("--warped", a->warped, "Writes the warped image (.nii.gz, .nii, .nrrd, .mha)");
  command->add_option("--count", a->count, "Points on each curve, at equal arc length")
      ->check(CLI::Range(2, 500))
      ->capture_default_str();
  command->add_option("--kernel", a->kernel, "r or r2logr (by default r in space, r2logr in the plane)")
      ->check(CLI::IsMember({"r", "r2logr"}));
  command->add_option("--regularisation", a->regularisation, "0 interpolates; more is smoother")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  add_json_flag(*command, context);
  command->footer(
      "The held-out error is that of a landmark, or of a whole curve, when the fit does not use it. Where every "
      "z of a side\n"
      "is the same, the spline is fitted in the plane.\n\nExamples:\n"
      "  bregma register curves sulci_mr.mrk.json sulci_ct.mrk.json\n"
      "  bregma register curves a.csv b.csv --source-points pa.csv --target-points pb.csv \\\n"
      "      --source-image mr.nii.gz --target-image ct.nii.gz --warped mr_on_ct.nii.gz");
  command->callback([a, &context] { context.run = [a, &context] { return register_curves(*a, context); }; });
}

} // namespace bregma::cli
