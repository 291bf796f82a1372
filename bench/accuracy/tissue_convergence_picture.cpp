#include <array>
#include <cmath>
#include <fstream>
#include <stdexcept>

#include "bench/accuracy/tissue_parts.hpp"

namespace bregma::bench {
namespace {

constexpr double kPictureWidth = 640.0;
constexpr double kPictureHeight = 440.0;
constexpr double kAxisLeft = 70.0;
constexpr double kAxisRight = 470.0;
constexpr double kAxisTop = 30.0;
constexpr double kAxisBottom = 390.0;
constexpr double kFinest_mm = 0.8, kCoarsest_mm = 12.0;
constexpr double kMinError = 1e-3, kMaxError = 0.5;
constexpr std::array<const char *, 6> kColours{"#1b6ca8", "#4fa3d1", "#9ccbe6", "#a8401b", "#d1774f", "#e6b49c"};

double x_of(double edge_mm) {
  return kAxisLeft + (kAxisRight - kAxisLeft) * std::log(edge_mm / kFinest_mm) / std::log(kCoarsest_mm / kFinest_mm);
}

double y_of(double error) {
  return kAxisBottom - (kAxisBottom - kAxisTop) * std::log(error / kMinError) / std::log(kMaxError / kMinError);
}

} // namespace

void draw_convergence(const std::vector<ErrorCurve> &curves, const std::string &file) {
  std::ofstream out(file);
  out << "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 " << kPictureWidth << ' ' << kPictureHeight
      << "' font-family='sans-serif' font-size='12'>\n<rect width='100%' height='100%' fill='white'/>\n";
  for (const double edge_mm : {1.0, 2.0, 5.0, 10.0}) {
    out << "<line x1='" << x_of(edge_mm) << "' x2='" << x_of(edge_mm) << "' y1='" << kAxisTop << "' y2='" << kAxisBottom
        << "' stroke='#ddd'/><text text-anchor='middle' x='" << x_of(edge_mm) << "' y='" << kAxisBottom + 16 << "'>"
        << edge_mm << "</text>\n";
  }
  for (const double error : {0.001, 0.01, 0.1}) {
    out << "<line x1='" << kAxisLeft << "' x2='" << kAxisRight << "' y1='" << y_of(error) << "' y2='" << y_of(error)
        << "' stroke='#ddd'/><text text-anchor='end' x='" << kAxisLeft - 6 << "' y='" << y_of(error) + 4 << "'>"
        << 100.0 * error << " %</text>\n";
  }
  // Reference line of second order.
  out << "<line x1='" << x_of(1.0) << "' y1='" << y_of(0.0015) << "' x2='" << x_of(10.0) << "' y2='" << y_of(0.15)
      << "' stroke='#888' stroke-dasharray='5 4'/><text x='" << x_of(1.05) << "' y='" << y_of(0.0011)
      << "' fill='#666'>second order</text>\n";
  for (std::size_t c = 0; c < curves.size(); ++c) {
    const char *colour = kColours[c % kColours.size()];
    out << "<polyline fill='none' stroke-width='2' stroke='" << colour << "' points='";
    for (std::size_t i = 0; i < curves[c].error.size(); ++i) {
      out << x_of(curves[c].edge_mm[i]) << ',' << y_of(curves[c].error[i]) << ' ';
    }
    out << "'/>\n";
    for (std::size_t i = 0; i < curves[c].error.size(); ++i) {
      out << "<circle r='3.5' fill='" << colour << "' cx='" << x_of(curves[c].edge_mm[i]) << "' cy='"
          << y_of(curves[c].error[i]) << "'/>\n";
    }
    out << "<text fill='" << colour << "' x='" << kAxisRight + 12 << "' y='"
        << kAxisTop + 20.0 * static_cast<double>(c + 1) << "'>" << curves[c].name << "</text>\n";
  }
  out << "<text x='" << 0.5 * (kAxisLeft + kAxisRight) << "' y='" << kPictureHeight - 14
      << "' text-anchor='middle'>edge (mm)</text>\n<text x='" << kAxisLeft << "' y='" << kAxisTop - 12
      << "'>error of the displacements, RMS by RMS</text>\n</svg>\n";
  if (!out.flush()) {
    throw std::runtime_error("cannot write " + file);
  }
}

} // namespace bregma::bench
