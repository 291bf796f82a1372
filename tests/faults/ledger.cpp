#include "tests/faults/ledger.hpp"

#include <algorithm>
#include <set>

namespace bregma::faults {

std::uint64_t DeviceLedger::lost(std::uint64_t first_arrivals) const {
  std::map<int, std::set<std::uint64_t>> series;
  for (std::size_t i = 0; i < std::min<std::size_t>(first_arrivals, arrivals_.size()); ++i) {
    if (arrivals_[i].counted) {
      series[arrivals_[i].series].insert(arrivals_[i].number);
    }
  }
  std::uint64_t out = 0;
  for (const auto &[number, numbers] : series) {
    out += *numbers.rbegin() - *numbers.begin() + 1 - numbers.size();
  }
  return out;
}

std::uint64_t DeviceLedger::arrivals(std::int64_t until_ns) const {
  const auto after = std::upper_bound(arrivals_.begin(), arrivals_.end(), until_ns,
                                      [](std::int64_t time_ns, const Arrival &one) { return time_ns < one.time_ns; });
  return static_cast<std::uint64_t>(after - arrivals_.begin());
}

const FrameTruth *Ledger::frame(std::uint64_t number) const {
  const auto found = frames.find(number);
  return found != frames.end() ? &found->second : nullptr;
}

void Ledger::clear_counts() {
  for (auto &[name, device] : devices) {
    device.clear();
  }
}

} // namespace bregma::faults
