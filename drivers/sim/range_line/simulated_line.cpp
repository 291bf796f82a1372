#include "drivers/sim/range_line/simulated_line.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::sim {
namespace {

bool is_due(unsigned every, std::uint64_t counter) { return every != 0 && counter % every == 0; }

} // namespace

std::string SimulatedRangeLine::receive(std::string_view bytes) {
  std::string out;
  lines_.take(bytes, [&](std::string_view line) {
    if (range::is_identity_question(line)) {
      out += range::line_of(identity_);
    }
  });
  return out;
}

std::string SimulatedRangeLine::advance(std::uint64_t now_us) {
  if (next_us_ == 0 || now_us > next_us_ + kBacklog_us) {
    const std::uint64_t skipped = next_us_ == 0 ? 0 : (now_us - next_us_) / kPeriod_us;
    counter_ += skipped; // the sensor went on while nothing was sent
    next_us_ = next_us_ == 0 ? now_us : next_us_ + skipped * kPeriod_us;
  }
  std::string out;
  for (; next_us_ <= now_us; next_us_ += kPeriod_us) {
    out += line();
  }
  return out;
}

std::string SimulatedRangeLine::line() {
  range::Reading reading{++counter_, next_us_, std::nullopt};
  if (!is_due(faults_.missing_every, counter_)) {
    const double highest = static_cast<double>((1U << identity_.bits) - 1U);
    const double counts = voltage_(next_us_) * 1e3 / identity_.full_scale_mV * highest;
    reading.counts = static_cast<std::uint32_t>(std::lround(std::clamp(counts, 0.0, highest)));
  }
  if (is_due(faults_.lost_every, counter_)) {
    return {};
  }
  std::string text = range::line_of(reading);
  if (is_due(faults_.garbled_every, counter_)) {
    const auto at = static_cast<std::size_t>(random_.uniform(0.0, static_cast<double>(text.size() - 2)));
    text[at] = static_cast<char>(text[at] ^ 0x10);
  }
  return text;
}

} // namespace bregma::sim
