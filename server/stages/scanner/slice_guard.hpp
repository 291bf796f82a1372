// Input check of a scanner's slices. Every ImageSlice passes here once: it is accepted, or rejected with a sentence and
// counted by reason. Accepted slices have finite numbers within a scanner's range, a rotation, as many pixels as rows
// and columns state, increasing numbers, times that pass as here, and fit the other slices of their series. The clock
// of a scanner may be set: that costs the series under way.
//
// One scanner. One thread. The sentence of a rejection is for the operator.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "idl/names.hpp"
#include "server/inputs/input_guard.hpp"

namespace bregma::server {

// Direction cosines or steps of two slices of one stack differ by less.
inline constexpr double kSameDirection = 1e-3;

struct SliceVerdict {
  bool accepted = false;
  wire::RejectReason reason = bregma_wire_REJECT_MALFORMED; // unless accepted
  std::string text;                                         // unless accepted
  bool other_writer = false; // accepted, and from another program than the one before: it counts anew
};

class SliceGuard {
public:
  static constexpr std::uint32_t kMaxPixels = 1U << 20U; // per slice
  static constexpr std::uint32_t kMaxSlices = 512;       // per series
  static constexpr std::uint64_t kMaxSeries = 1U << 27U; // pixels of a series: a stage keeps two as numbers of 4 bytes

  explicit SliceGuard(const wire::Name &device);

  [[nodiscard]] SliceVerdict check(const wire::ImageSlice &slice, std::uint64_t writer, std::int64_t now_ns);
  void set_writers_alive(std::uint32_t count) noexcept { writers_ = count; }

  [[nodiscard]] std::uint64_t taken() const noexcept { return health_.taken; }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_; }
  [[nodiscard]] inputs::StreamHealth health(std::int64_t now_ns) const noexcept;

private:
  struct Refusal {
    wire::RejectReason reason;
    std::string text;
  };
  using Check = std::optional<Refusal>;
  [[nodiscard]] static Check check_header(const wire::ImageSlice &slice);
  [[nodiscard]] Check check_writer(std::uint64_t writer, std::int64_t now_ns);
  [[nodiscard]] Check check_order(const wire::ImageSlice &slice, std::int64_t now_ns) const;
  [[nodiscard]] Check check_series(const wire::ImageSlice &slice) const;
  void take(const wire::ImageSlice &slice, std::uint64_t writer, std::int64_t now_ns);

  wire::DeviceHealth health_{};
  std::uint64_t refused_ = 0;
  std::uint64_t unknown_ = 0;
  std::uint32_t writers_ = 1;
  std::uint64_t writer_ = 0;
  std::int64_t arrived_ns_ = 0; // of the last accepted slice; 0: none
  std::uint64_t frame_ = 0;
  std::int64_t device_time_ns_ = 0;
  std::int64_t lead_ns_ = 0; // device time minus arrival, of the first slice of the series under way
  // The series under way: its first slice without pixels, and which indices were taken.
  wire::ImageSlice first_{};
  std::vector<bool> seen_;
};

// Unit vector along the rows, the columns and the normal of a slice, as columns. Precondition: an accepted slice.
[[nodiscard]] Eigen::Matrix3d axes_of(const wire::ImageSlice &slice);

} // namespace bregma::server
