// What `bregma doctor` measures on this machine. Every measurement blocks for as long as it says.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "base/result.hpp"

namespace bregma::cli {

struct Spread {
  std::size_t count = 0;
  double p50 = 0.0;
  double p99 = 0.0;
  double p999 = 0.0;
  double max = 0.0;
};
[[nodiscard]] Spread spread_of(std::vector<double> values);

struct LoopbackQuality {
  Spread round_trip_us; // write of a tracker frame to the take of the state that another process answers with
  std::size_t sent = 0; // those above that are missing got no answer
};

// A second process that answers every tracker frame with a navigation state, on a DDS domain of its own: the least that
// any daemon would need. Make it before the first thread and the first DDS entity of this process.
class EchoProcess {
public:
  explicit EchoProcess(std::uint32_t domain);
  ~EchoProcess(); // ends it
  EchoProcess(const EchoProcess &) = delete;
  EchoProcess &operator=(const EchoProcess &) = delete;

  [[nodiscard]] base::Result<LoopbackQuality> measure(double rate_hz, std::chrono::nanoseconds duration);

private:
  std::uint32_t domain_;
  int process_ = -1;
};

// Writes and fsyncs blocks as large as the recorder's commits, in a file that is gone afterwards. Milliseconds.
[[nodiscard]] base::Result<Spread> measure_disk(const std::filesystem::path &directory, int blocks);

// The directory itself or the nearest above it that exists.
[[nodiscard]] std::filesystem::path existing_part(std::filesystem::path directory);

} // namespace bregma::cli
