#include "server/recording/recording_space.hpp"

#include <algorithm>
#include <system_error>

#include "casefile/session_file/growth.hpp"

namespace bregma::recording {
namespace {

constexpr double kMinute_s = 60.0;

} // namespace

void RecordingGrowth::observe(std::uint64_t bytes, double time_s) {
  if (bytes_per_s_ <= 0.0) {
    bytes_per_s_ = casefile::kTypicalBytesPerSecond;
    minute_bytes_ = bytes;
    minute_began_s_ = time_s;
    return;
  }
  const double elapsed_s = time_s - minute_began_s_;
  if (elapsed_s < kMinute_s) {
    return;
  }
  // A file never shrinks for good: its log is emptied after it was copied.
  const double grown = bytes > minute_bytes_ ? static_cast<double>(bytes - minute_bytes_) : 0.0;
  const double rate = std::max(grown / elapsed_s, 1.0);
  bytes_per_s_ = measured_ ? std::max(bytes_per_s_, rate) : rate;
  measured_ = true;
  minute_bytes_ = bytes;
  minute_began_s_ = time_s;
}

std::uint64_t recording_bytes(const std::filesystem::path &file) {
  std::uint64_t sum = 0;
  for (const std::filesystem::path &part : {file, std::filesystem::path(file.string() + "-wal")}) {
    std::error_code error;
    const auto size = std::filesystem::file_size(part, error);
    sum += error ? 0 : size;
  }
  return sum;
}

} // namespace bregma::recording
