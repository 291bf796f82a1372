// The thesis' figures 2.3, 4.3 to 4.5, 5.1 and 5.4 on the images of this benchmark, as SVG.
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <utility>

#include <Eigen/Geometry>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/intensity/joint_histogram.hpp"
#include "algorithms/intensity/warp.hpp"
#include "base/plots.hpp"
#include "base/write_file.hpp"
#include "bench/accuracy/intensity_parts.hpp"
#include "casefile/volumes/render.hpp"

namespace bregma::bench {

namespace {

using intensity::AigReading;
using intensity::Measure;
using intensity::MeasureOptions;
using intensity::Volume;

constexpr int kCaption = 24; // height of the line above a panel

std::string base64(const std::vector<std::uint8_t> &bytes) { // RFC 4648
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    const std::size_t here = std::min<std::size_t>(bytes.size() - i, 3);
    for (std::size_t k = 0; k < 3; ++k) {
      group = (group << 8U) | (k < here ? bytes[i + k] : 0U);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      out += k <= here ? kDigits[(group >> (18U - 6U * k)) & 63U] : '=';
    }
  }
  return out;
}

// Panels beside and below each other, each with its caption.
class Sheet {
public:
  Sheet(int columns, base::Size panel) : columns_(columns), panel_(panel) {}

  void add(const std::string &caption, const std::string &content) {
    const int left = (count_ % columns_) * panel_.width;
    const int top = (count_ / columns_) * (panel_.height + kCaption);
    body_ += "<text x='" + std::to_string(left + 10) + "' y='" + std::to_string(top + 17) + "'>" +
             base::escape(caption) + "</text>\n<svg x='" + std::to_string(left) + "' y='" +
             std::to_string(top + kCaption) + "' width='" + std::to_string(panel_.width) + "' height='" +
             std::to_string(panel_.height) + "'>" + content + "</svg>\n";
    ++count_;
  }
  void add(const std::string &caption, const base::Plot &plot) { add(caption, base::plot_svg(plot, panel_)); }
  // Greys from 0 to 1, row by row from the bottom; line: a row to mark, or -1.
  void add(const std::string &caption, const std::vector<float> &grey, int size, int line = -1) {
    casefile::Image picture{size, size, {}};
    for (int y = size - 1; y >= 0; --y) {
      for (int x = 0; x < size; ++x) {
        const float v =
            grey[static_cast<std::size_t>(y) * static_cast<std::size_t>(size) + static_cast<std::size_t>(x)];
        const auto level = static_cast<std::uint8_t>(255.0F * std::clamp(std::isfinite(v) ? v : 0.0F, 0.0F, 1.0F));
        const bool marked = y == line && x % 8 < 4;
        picture.rgb.insert(picture.rgb.end(), {marked ? std::uint8_t{230} : level, marked ? std::uint8_t{159} : level,
                                               marked ? std::uint8_t{0} : level});
      }
    }
    const auto png = casefile::encode_png(picture);
    if (!png) {
      throw std::runtime_error(png.error().message);
    }
    add(caption, "<image width='" + std::to_string(panel_.width - 10) + "' height='" + std::to_string(panel_.height) +
                     "' image-rendering='pixelated' href='data:image/png;base64," + base64(*png) + "'/>");
  }

  void write(const IntensityOptions &options, const std::string &name) const {
    const int rows = (count_ + columns_ - 1) / columns_;
    const std::string width = std::to_string(std::min(count_, columns_) * panel_.width);
    const std::string height = std::to_string(rows * (panel_.height + kCaption));
    const auto file = std::filesystem::path(options.pictures) / name;
    const std::string text =
        "<svg xmlns='http://www.w3.org/2000/svg' width='" + width + "' height='" + height + "' viewBox='0 0 " + width +
        " " + height + "' font-family='sans-serif' font-size='14'>\n<rect width='100%' height='100%' fill='white'/>\n" +
        body_ + "</svg>\n";
    if (auto written = base::write_file(file, text); !written) {
      throw std::runtime_error(written.error().message);
    }
  }

private:
  int columns_;
  base::Size panel_;
  int count_ = 0;
  std::string body_;
};

struct Curve {
  std::string name;
  Measure measure;
  MeasureOptions how;
  const char *colour;
  bool dashed = false;
};

// Curves of measures over rotation or translation, each from its smallest to its largest value: measures have different
// units. Reports where each is largest.
base::Plot curves_of(Report &report, const std::string &title, const Volume &reference, const Volume &floating,
                     const Sweep &sweep, const std::vector<Curve> &curves) {
  parallel::Team team(bench_threads());
  base::Plot plot;
  plot.title = title;
  plot.x = {sweep.rotation ? "rotation, deg" : "translation, pixels", false, -sweep.reach, sweep.reach};
  plot.y = {"similarity, 0 to 1", false, 0.0, 1.0};
  plot.rules.push_back({base::RuleKind::kVertical, 0.0, "", base::colour::kGrey});
  for (const Curve &curve : curves) {
    const auto measure = intensity::make_measure(curve.measure, reference, floating, curve.how, team);
    const std::vector<double> values = similarity_curve(*measure, sweep);
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    base::Series series{curve.name, curve.colour, base::Mark::kLine, {}, curve.dashed ? 1.2 : 1.8, curve.dashed, 1.0};
    for (std::size_t i = 0; i < values.size(); ++i) {
      series.points.push_back({static_cast<double>(i) - sweep.reach, (values[i] - *low) / (*high - *low)});
    }
    plot.series.push_back(std::move(series));
    report.add(figure(title + " " + curve.name, static_cast<double>(high - values.begin()) - sweep.reach,
                      sweep.rotation ? "deg" : "pixels"));
  }
  return plot;
}

std::vector<Curve> chapter_4(bool both_ways) {
  std::vector<Curve> out;
  for (const auto &[measure, name, colour] : {std::tuple{Measure::kNmi, "NMI", base::colour::kBlue},
                                              {Measure::kGmi, "GMI", base::colour::kOrange},
                                              {Measure::kAmi, "AMI", base::colour::kGreen}}) {
    out.push_back({name, measure, off_grid(), colour, false});
    if (both_ways) {
      out.push_back({std::string(name) + " as printed", measure, as_printed(), colour, true});
    }
  }
  return out;
}

// Joint histogram of a slice with itself turned by an angle; logarithmic, as one pixel and ten thousand must both show.
void figure_2_3(Report &report, const IntensityOptions &options, const Planes &planes) {
  constexpr int kBins = 64;
  Sheet sheet(3, {300, 290});
  for (const double angle : {0.0, 1.0, 5.0}) {
    const Eigen::AngleAxisd turn(angle * geometry::kRadiansPerDegree, Eigen::Vector3d::UnitZ());
    const std::vector<float> turned =
        intensity::warp<3>(planes.t1, planes.t1, planes.t1.voxels,
                           [&turn](const Eigen::Vector3d &p) -> Eigen::Vector3d { return turn * p; });
    const intensity::BinScale scale = intensity::bin_scale(0.0F, 1.0F, kBins, false);
    std::vector<std::uint16_t> rows;
    std::vector<float> columns;
    for (std::size_t i = 0; i < turned.size(); ++i) {
      rows.push_back(intensity::bin_at(scale(planes.t1.voxels[i])));
      columns.push_back(intensity::bin_at(scale(std::isfinite(turned[i]) ? turned[i] : 0.0F)));
    }
    intensity::JointHistogram histogram(kBins, kBins);
    histogram.add_binned(rows, columns);
    std::vector<float> grey(histogram.counts().begin(), histogram.counts().end());
    const float largest = std::log1p(*std::max_element(grey.begin(), grey.end()));
    for (float &v : grey) {
      v = std::log1p(v) / largest;
    }
    const double joint = histogram.summarise().joint;
    const std::string degrees = std::to_string(static_cast<int>(angle));
    report.add(figure("figure 2.3 joint entropy at " + degrees + " deg", joint, "nats"));
    std::array<char, 80> caption{};
    std::snprintf(caption.data(), caption.size(), "turned by %s°, joint entropy %.2f nats", degrees.c_str(), joint);
    sheet.add(caption.data(), grey, kBins);
  }
  sheet.write(options, "images_2_3.svg");
}

void figures_of_chapter_4(Report &report, const IntensityOptions &options, const Planes &planes) {
  constexpr base::Size kPanel{470, 290};
  constexpr double kNextSlice_mm = 14.0;
  const Volume next = plane_of(load_volume(options.mni + "/avg152T1.nii.gz"), kNextSlice_mm);
  Sheet same(2, kPanel);
  for (const bool rotation : {true, false}) {
    same.add(rotation ? "MR/MR, rotation" : "MR/MR, translation",
             curves_of(report, rotation ? "figure 4.3 (a)" : "figure 4.3 (b)", planes.t1, next, {rotation, 20},
                       chapter_4(true)));
  }
  same.write(options, "images_4_3.svg");

  Sheet two(2, kPanel);
  for (const auto &[reach, rotation, panel] :
       {std::tuple{20, true, "(a)"}, {20, false, "(b)"}, {60, true, "(c)"}, {60, false, "(d)"}}) {
    two.add(std::string(panel) + (rotation ? " CT/MR, rotation" : " CT/MR, translation"),
            curves_of(report, std::string("figure 4.4 ") + panel, planes.ct, planes.t1, {rotation, reach},
                      chapter_4(true)));
  }
  two.write(options, "images_4_4.svg");

  Sheet noise(2, kPanel);
  for (const int percent : {1, 2, 3, 4, 5}) {
    const Volume noisy = with_noise(planes.t1, 0.01 * percent, static_cast<unsigned>(100 * (percent - 1)));
    const std::string variance = "0.0" + std::to_string(percent);
    noise.add("CT/MR, noise of variance " + variance,
              curves_of(report, "figure 4.5 " + variance, planes.ct, noisy, {true, 60}, chapter_4(true)));
  }
  noise.write(options, "images_4_5.svg");
}

// Values of the middle row, scaled to 0 to 1.
base::Plot profile_of(const std::string &title, const std::vector<float> &values, int size, int row) {
  base::Plot plot;
  plot.title = title;
  plot.x = {"pixel", false, 0.0, static_cast<double>(size)};
  plot.y = {"value, 0 to 1", false, 0.0, 1.0};
  base::Series series{"", base::colour::kBlue, base::Mark::kLine, {}, 1.5, false, 1.0};
  for (int x = 0; x < size; ++x) {
    const std::size_t at = static_cast<std::size_t>(row) * static_cast<std::size_t>(size) + static_cast<std::size_t>(x);
    series.points.push_back({static_cast<double>(x), static_cast<double>(values[at])});
  }
  plot.series.push_back(std::move(series));
  return plot;
}

void figure_5_1(Report &report, const IntensityOptions &options, const Planes &planes) {
  parallel::Team team(bench_threads());
  const int size = planes.t1.size[0];
  const int row = size / 2;
  const auto scaled = [](std::vector<float> values) {
    const intensity::GreyRange range = intensity::grey_range(values);
    for (float &v : values) {
      v = range.constant() ? 0.0F : (v - range.low) / (range.high - range.low);
    }
    return values;
  };
  const std::vector<std::pair<std::string, std::vector<float>>> maps{
      {"MR-T1", scaled(planes.t1.voxels)},
      {"gradient", scaled(intensity::gradient_magnitude(planes.t1, team))},
      {"AIG as printed", scaled(intensity::adaptive_image_gradient(planes.t1, AigReading::kPrinted, team))},
      {"AIG, distance x grey",
       scaled(intensity::adaptive_image_gradient(planes.t1, AigReading::kDistanceTimesGrey, team))}};
  Sheet sheet(4, {290, 280});
  for (const auto &[name, values] : maps) {
    sheet.add(name, values, size, row);
    const auto zero = std::count_if(values.begin(), values.end(), [](float v) { return v == 0.0F; });
    report.add(figure("figure 5.1 zero in " + name,
                      100.0 * static_cast<double>(zero) / static_cast<double>(values.size()), "%"));
  }
  for (const auto &[name, values] : maps) {
    sheet.add("dashed line of " + name, profile_of(name, values, size, row));
  }
  sheet.write(options, "images_5_1.svg");
}

void figure_5_4(Report &report, const IntensityOptions &options, const Planes &planes) {
  Sheet sheet(2, {470, 290});
  for (const int field : {90, 80, 70, 60, 50}) {
    const Volume part = with_field_of_view(planes.t2, 0.01 * field);
    const std::string percent = std::to_string(field) + " %";
    sheet.add("CT/T2, field of view " + percent,
              curves_of(report, "figure 5.4 " + percent, planes.ct, part, {true, 30},
                        {{"NMI as printed", Measure::kNmi, as_printed(), base::colour::kBlue, true},
                         {"NMI", Measure::kNmi, well_made(), base::colour::kBlue, false},
                         {"MF-MI", Measure::kMfMi, well_made(), base::colour::kGreen, false}}));
  }
  sheet.write(options, "images_5_4.svg");
}

} // namespace

void drawn_figures(Report &report, const IntensityOptions &options) {
  if (options.pictures.empty()) {
    report.note("figures 2.3, 4.3, 4.4, 4.5, 5.1 and 5.4: --pictures names the folder to draw them in");
    return;
  }
  const Planes planes(options);
  figure_2_3(report, options, planes);
  figures_of_chapter_4(report, options, planes);
  figure_5_1(report, options, planes);
  figure_5_4(report, options, planes);
}

} // namespace bregma::bench
