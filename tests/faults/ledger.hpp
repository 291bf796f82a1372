// What has truly arrived at the daemon: the judge compares the daemon's counts and poses with it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "idl/topics.hpp"

namespace bregma::faults {

// Samples of one device. A number counts once, however often it arrives.
class DeviceLedger {
public:
  // counted: the sample belongs to the device's own count. False for another writer's. sent_ns: when the device sent
  // it.
  void arrived(std::uint64_t number, bool counted, std::int64_t sent_ns, std::int64_t now_ns) {
    arrivals_.push_back({number, series_, counted, now_ns});
    newest_sent_ns_ = std::max(newest_sent_ns_, sent_ns);
  }
  // The device's numbers begin anew; those that are lost in between cannot be known.
  void restart_numbers() { ++series_; }
  void clear() { arrivals_.clear(); }

  // When the newest of the samples that have arrived was sent; 0: none has arrived.
  [[nodiscard]] std::int64_t newest_sent_ns() const { return newest_sent_ns_; }
  // Number of samples that had arrived at this time.
  [[nodiscard]] std::uint64_t arrivals(std::int64_t until_ns) const;
  // Numbers that are missing among the first arrivals: last - first + 1 - distinct numbers, for each series.
  [[nodiscard]] std::uint64_t lost(std::uint64_t first_arrivals) const;

private:
  struct Arrival {
    std::uint64_t number;
    int series;
    bool counted;
    std::int64_t time_ns;
  };
  std::vector<Arrival> arrivals_;
  int series_ = 0;
  std::int64_t newest_sent_ns_ = 0;
};

// A tracker frame as it arrived.
struct FrameTruth {
  std::int64_t exposure_ns = 0; // true time at which its poses were measured
  bool unusable = false;        // no pose of it may be shown
  std::string unusable_tool;    // no pose of this tool may be shown; empty: none
};

struct Ledger {
  std::map<std::string, DeviceLedger> devices;
  std::map<std::uint64_t, FrameTruth> frames; // by number; of equal numbers the last

  [[nodiscard]] const FrameTruth *frame(std::uint64_t number) const;
  // Another daemon counts from zero.
  void clear_counts();
};

} // namespace bregma::faults
