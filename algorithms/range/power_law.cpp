#include "algorithms/range/power_law.hpp"

#include <algorithm>
#include <cstdio>
#include <iterator>

#include <Eigen/Dense>

namespace bregma::range {

namespace {

constexpr int kMaxSteps = 100;
constexpr double kConverged = 1e-12; // relative change of both parameters
constexpr double kSignificant = 3.0; // standard errors of a stretch's mean

Eigen::Vector2d gradient_of(const PowerLaw &law, double reading) {
  const double power = std::pow(reading, law.exponent);
  return {power, law.scale_mm * power * std::log(reading)};
}

PowerLaw start_from(std::span<const CalibrationPoint> points) {
  double x = 0.0;
  double y = 0.0;
  double xx = 0.0;
  double xy = 0.0;
  for (const CalibrationPoint &p : points) {
    const double u = std::log(p.reading);
    const double v = std::log(p.distance_mm);
    x += u;
    y += v;
    xx += u * u;
    xy += u * v;
  }
  const auto n = static_cast<double>(points.size());
  const double b = (xy - x * y / n) / (xx - x * x / n);
  return {std::exp((y - b * x) / n), b};
}

// Gauss-Newton with halved steps; false if it does not converge.
bool refine(std::span<const CalibrationPoint> points, PowerLaw &law) {
  const auto cost = [&points](const PowerLaw &l) {
    double sum = 0.0;
    for (const CalibrationPoint &p : points) {
      sum += std::pow(p.distance_mm - l.distance_mm(p.reading), 2);
    }
    return sum;
  };
  double now = cost(law);
  for (int step = 0; step < kMaxSteps; ++step) {
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (const CalibrationPoint &p : points) {
      const Eigen::Vector2d g = gradient_of(law, p.reading);
      normal += g * g.transpose();
      right += g * (p.distance_mm - law.distance_mm(p.reading));
    }
    Eigen::Vector2d move = normal.ldlt().solve(right);
    PowerLaw next{law.scale_mm + move[0], law.exponent + move[1]};
    for (int half = 0; half < 30 && !(cost(next) <= now); ++half) {
      move *= 0.5;
      next = {law.scale_mm + move[0], law.exponent + move[1]};
    }
    if (!(cost(next) <= now)) {
      return std::isfinite(now); // no step improves: the minimum, to rounding
    }
    law = next;
    now = cost(law);
    if (std::abs(move[0]) < kConverged * std::abs(law.scale_mm) &&
        std::abs(move[1]) < kConverged * std::abs(law.exponent)) {
      return true;
    }
  }
  return false;
}

template <class... Values> std::string sentence(const char *pattern, Values... values) {
  char buffer[300];
  std::snprintf(buffer, sizeof buffer, pattern, values...);
  return buffer;
}

void settle(PowerLawFit &out, PowerLawVerdict verdict, std::string text) {
  out.verdict = verdict;
  out.text = (verdict == PowerLawVerdict::kAccepted ? "accepted: " : "refused: ") + std::move(text);
}

// Mean reading and distance of equal shares of the points, which are sorted by distance; and the residuals there.
struct Stretch {
  double from_mm, to_mm, reading, bias_mm, error_mm; // error: standard error of the bias
};
std::vector<Stretch> stretches_of(std::span<const CalibrationPoint> sorted, std::size_t count, const PowerLaw &law) {
  std::vector<Stretch> out;
  for (std::size_t s = 0; s < count; ++s) {
    const std::size_t from = s * sorted.size() / count;
    const std::size_t to = (s + 1) * sorted.size() / count;
    if (to - from < 2) {
      continue;
    }
    const auto n = static_cast<double>(to - from);
    Stretch stretch{sorted[from].distance_mm, sorted[to - 1].distance_mm, 0.0, 0.0, 0.0};
    for (std::size_t i = from; i < to; ++i) {
      stretch.reading += sorted[i].reading / n;
      stretch.bias_mm += (sorted[i].distance_mm - law.distance_mm(sorted[i].reading)) / n;
    }
    double squares = 0.0;
    for (std::size_t i = from; i < to; ++i) {
      const double r = sorted[i].distance_mm - law.distance_mm(sorted[i].reading) - stretch.bias_mm;
      squares += r * r;
    }
    stretch.error_mm = std::sqrt(squares / (n - 1.0) / n);
    out.push_back(stretch);
  }
  return out;
}

// A turning point of the mean reading: the distance where it is, or NaN.
double turning_mm(const std::vector<Stretch> &stretches) {
  const bool falls = stretches.back().reading < stretches.front().reading;
  for (std::size_t i = 0; i + 1 < stretches.size(); ++i) {
    if ((stretches[i + 1].reading < stretches[i].reading) != falls) {
      return stretches[i].to_mm;
    }
  }
  return std::nan("");
}

} // namespace

double RangeCurve::distance_mm(double reading) const {
  const double plain = law.distance_mm(reading);
  if (corrections.empty() || !(reading > 0.0)) {
    return plain;
  }
  const auto above = std::find_if(corrections.begin(), corrections.end(),
                                  [reading](const CurveCorrection &c) { return c.reading >= reading; });
  if (above == corrections.begin()) {
    return plain + corrections.front().add_mm;
  }
  if (above == corrections.end()) {
    return plain + corrections.back().add_mm;
  }
  const CurveCorrection &below = *std::prev(above);
  const double part = (reading - below.reading) / (above->reading - below.reading);
  return plain + below.add_mm + part * (above->add_mm - below.add_mm);
}

double PowerLawFit::sigma_mm(double reading) const {
  const Eigen::Vector2d g = gradient_of(law, reading);
  return std::sqrt(g.dot(covariance * g));
}

PowerLawFit fit_power_law(std::span<const CalibrationPoint> points, const PowerLawOptions &options) {
  PowerLawFit out;
  if (points.size() < options.min_points) {
    settle(out, PowerLawVerdict::kTooFewPoints,
           sentence("%zu points, at least %zu are needed", points.size(), options.min_points));
    return out;
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    const CalibrationPoint &p = points[i];
    if (!(p.reading > 0.0) || !(p.distance_mm > 0.0) || !std::isfinite(p.reading) || !std::isfinite(p.distance_mm)) {
      settle(out, PowerLawVerdict::kInvalidPoint,
             sentence("point %zu: reading %g at %g mm: both must be positive", i + 1, p.reading, p.distance_mm));
      return out;
    }
  }
  std::vector<CalibrationPoint> sorted(points.begin(), points.end());
  std::sort(sorted.begin(), sorted.end(), [](const auto &a, const auto &b) { return a.distance_mm < b.distance_mm; });
  const double ratio = sorted.back().distance_mm / sorted.front().distance_mm;
  if (!(ratio >= options.min_distance_ratio)) {
    settle(
        out, PowerLawVerdict::kTooNarrow,
        sentence("distances from %.0f to %.0f mm do not determine the exponent: their ratio is %.2f, at least %.1f is "
                 "needed",
                 sorted.front().distance_mm, sorted.back().distance_mm, ratio, options.min_distance_ratio));
    return out;
  }
  out.law = start_from(points);
  out.estimated = std::isfinite(out.law.scale_mm) && std::isfinite(out.law.exponent) && refine(points, out.law);
  const auto stretches = stretches_of(sorted, options.stretches, out.law);
  if (const double turn = turning_mm(stretches); !std::isnan(turn)) {
    settle(
        out, PowerLawVerdict::kNotMonotone,
        sentence("the reading turns at about %.0f mm, so that it means two distances: calibrate one side only", turn));
    return out;
  }
  if (!out.estimated) {
    settle(out, PowerLawVerdict::kDoesNotFit, "the fit did not converge");
    return out;
  }
  Eigen::Matrix2d bread = Eigen::Matrix2d::Zero();
  Eigen::Matrix2d filling = Eigen::Matrix2d::Zero();
  double squares = 0.0;
  for (const CalibrationPoint &p : points) {
    const Eigen::Vector2d g = gradient_of(out.law, p.reading);
    const double r = p.distance_mm - out.law.distance_mm(p.reading);
    bread += g * g.transpose();
    filling += r * r * g * g.transpose();
    squares += r * r;
    out.worst_mm = std::max(out.worst_mm, std::abs(r));
  }
  const auto n = static_cast<double>(points.size());
  const Eigen::Matrix2d inverse = bread.inverse();
  out.covariance = n / (n - 2.0) * inverse * filling * inverse;
  out.rms_mm = std::sqrt(squares / n);
  for (const Stretch &s : stretches) {
    if (std::abs(s.bias_mm) > options.max_bias_mm && std::abs(s.bias_mm) > kSignificant * s.error_mm) {
      out.misfits.push_back({s.from_mm, s.to_mm, s.bias_mm});
    }
  }
  for (const Stretch &s : stretches) {
    out.corrections.push_back({s.reading, s.bias_mm});
  }
  std::sort(out.corrections.begin(), out.corrections.end(),
            [](const auto &a, const auto &b) { return a.reading < b.reading; });
  const RangeCurve corrected = out.corrected();
  double corrected_squares = 0.0;
  for (const CalibrationPoint &p : points) {
    corrected_squares += std::pow(p.distance_mm - corrected.distance_mm(p.reading), 2);
  }
  out.corrected_rms_mm = std::sqrt(corrected_squares / n);
  if (out.misfits.empty()) {
    settle(out, PowerLawVerdict::kAccepted,
           sentence("distance = %.4g mm * reading^%.4f, RMS %.2f mm over %zu points", out.law.scale_mm,
                    out.law.exponent, out.rms_mm, points.size()));
    return out;
  }
  std::string where;
  for (const Misfit &m : out.misfits) {
    where += sentence("%s%.0f to %.0f mm (%+.1f mm)", where.empty() ? "" : ", ", m.from_mm, m.to_mm, m.bias_mm);
  }
  settle(out, PowerLawVerdict::kDoesNotFit, "a power law does not fit at " + where);
  return out;
}

} // namespace bregma::range
