// The measurements of `bregma doctor` on this machine. Every measurement blocks for the given time.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "base/result.hpp"
#include "casefile/session_file/growth.hpp"

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
  Spread round_trip_us; // from the write of a tracker frame to the read of the state that another process returns
  std::size_t sent = 0; // frames without an entry above got no answer
};

// A second process that answers every tracker frame with a navigation state, on a DDS domain of its own: the minimum
// for any daemon. Create it before the first thread and the first DDS entity of this process.
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

// Writes and fsyncs blocks as large as the recorder's commits, in a temporary file. Milliseconds.
[[nodiscard]] base::Result<Spread> measure_disk(const std::filesystem::path &directory, int blocks);

// For a recording of the typical growth.
[[nodiscard]] base::Result<casefile::RecordingSpace> recording_space(const std::filesystem::path &directory);

// The directory itself or its nearest existing parent.
[[nodiscard]] std::filesystem::path existing_part(std::filesystem::path directory);

} // namespace bregma::cli
