#include "algorithms/range/range_filters.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace bregma::range {

namespace {

constexpr double kSigmaOfMad = 1.4826; // sigma of a normal variable over its median absolute deviation

double median_in_place(std::vector<double> &values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) {
    return *middle;
  }
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

} // namespace

WindowFilter::WindowFilter(const WindowOptions &options) : options_(options), ring_(options.window) {
  if (options.window == 0) {
    throw std::invalid_argument("window = 0: must be at least 1 reading");
  }
  if (!(options.reject_sigmas > 0.0)) {
    throw std::invalid_argument("reject_sigmas must be positive");
  }
  scratch_.reserve(options.window);
}

void WindowFilter::reset() { next_ = count_ = 0; }

void WindowFilter::add(const TimedReading &reading) {
  ring_[next_] = reading;
  next_ = (next_ + 1) % ring_.size();
  count_ = std::min(count_ + 1, ring_.size());
}

std::optional<FilteredReading> WindowFilter::value() {
  if (count_ < ring_.size()) {
    return std::nullopt;
  }
  scratch_.clear();
  for (const TimedReading &r : ring_) {
    if (std::isfinite(r.value)) {
      scratch_.push_back(r.value);
    }
  }
  if (scratch_.empty()) {
    return std::nullopt;
  }
  const std::int64_t newest_ns = ring_[(next_ + ring_.size() - 1) % ring_.size()].time_ns;
  const bool median = options_.kind == WindowKind::kMedian;
  const double middle = median ? median_in_place(scratch_) : 0.0;
  const Bounds kept = bounds(); // of all where the median is the value: it belongs to the window's mean time
  FilteredReading out;
  double sum = 0.0;
  double after_ns = 0.0; // mean time, relative to the newest
  for (const TimedReading &r : ring_) {
    if (r.value >= kept.low && r.value <= kept.high) { // false for NaN
      sum += r.value;
      after_ns += static_cast<double>(r.time_ns - newest_ns);
      ++out.used;
    }
  }
  const auto used = static_cast<double>(out.used);
  out.delay_ns = options_.sensor_delay_ns - std::llround(after_ns / used);
  out.time_ns = newest_ns - out.delay_ns;
  out.value = median ? middle : sum / used;
  return out;
}

WindowFilter::Bounds WindowFilter::bounds() {
  constexpr double kAll = std::numeric_limits<double>::infinity();
  if (options_.kind == WindowKind::kRejectingMean) {
    double mean = 0.0;
    for (const double v : scratch_) {
      mean += v / static_cast<double>(scratch_.size());
    }
    double squares = 0.0;
    for (const double v : scratch_) {
      squares += (v - mean) * (v - mean) / static_cast<double>(scratch_.size());
    }
    const double reach = options_.reject_sigmas * std::sqrt(squares);
    return {mean - reach, mean + reach};
  }
  if (options_.kind == WindowKind::kHampel) {
    const double middle = median_in_place(scratch_);
    for (double &v : scratch_) {
      v = std::abs(v - middle);
    }
    const double reach = options_.reject_sigmas * kSigmaOfMad * median_in_place(scratch_);
    return {middle - reach, middle + reach};
  }
  return {-kAll, kAll};
}

RangeChain::RangeChain(const ChainOptions &options, RangeCurve calibration)
    : options_(options), calibration_(std::move(calibration)), raw_(options.raw),
      smooth_({WindowKind::kMean, options.smoothing, 1.0, 0}) {
  if (options.every == 0) {
    throw std::invalid_argument("every = 0: must be at least 1");
  }
}

std::optional<FilteredReading> RangeChain::push(const TimedReading &reading) {
  raw_.add(reading);
  const std::size_t until_wanted = (options_.every - index_++ % options_.every) % options_.every;
  if (until_wanted >= options_.smoothing) {
    return std::nullopt;
  }
  const auto raw = raw_.value();
  smooth_.add(raw ? TimedReading{raw->time_ns, calibration_.distance_mm(raw->value)}
                  : TimedReading{reading.time_ns, std::nan("")});
  if (until_wanted > 0) {
    return std::nullopt;
  }
  auto smooth = smooth_.value();
  if (smooth) {
    smooth->delay_ns = reading.time_ns - smooth->time_ns;
    smooth->used = raw ? raw->used : 0;
  }
  return smooth;
}

} // namespace bregma::range
