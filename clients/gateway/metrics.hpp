// Prometheus' view of the gateway and of the daemon that it follows.
//
// Threads: the counters and histograms may be changed by any thread.
#pragma once

#include <cstdint>
#include <string>

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include "clients/gateway/record_store.hpp"

namespace bregma::gateway {

class Metrics {
public:
  Metrics();

  prometheus::Registry registry; // owns what the references below refer to
  prometheus::Counter &connections;
  prometheus::Counter &refused_connections; // above the limit
  prometheus::Gauge &open_connections;
  prometheus::Gauge &watchers; // sockets of /state
  prometheus::Counter &frames;
  prometheus::Counter &frame_bytes;
  prometheus::Counter &closed_slow; // sockets that took nothing for 2 s
  prometheus::Counter &closed_bad;  // and those that said what they may not
  prometheus::Histogram &written_s; // a tool's sample taken from DDS, to the socket's taking its frame
  void count_answer(int status);

  // The text format. The daemon's figures are those of its latest records: bregma_device_rate_hz{device="Tracker"}.
  [[nodiscard]] std::string text(const RecordStore &store) const;

private:
  prometheus::Family<prometheus::Counter> &answers_;
};

} // namespace bregma::gateway
