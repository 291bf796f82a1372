// How fast the recording of a session grows.
#pragma once

#include <cstdint>
#include <filesystem>

namespace bregma::recording {

// The rate of a file that grows unevenly: its fastest minute, since an operation has quiet ones. During the first
// minute casefile::kTypicalBytesPerSecond.
class RecordingGrowth {
public:
  // bytes: size of the file; time_s increases.
  void observe(std::uint64_t bytes, double time_s);
  [[nodiscard]] double bytes_per_s() const { return bytes_per_s_; }

private:
  double bytes_per_s_ = 0.0; // 0: not observed yet
  bool measured_ = false;    // a whole minute
  std::uint64_t minute_bytes_ = 0;
  double minute_began_s_ = 0.0;
};

// Size of a session file with its log. 0 if it cannot be read. Waits for the disk.
[[nodiscard]] std::uint64_t recording_bytes(const std::filesystem::path &file);

} // namespace bregma::recording
