// The border of the scanner's slices: every fault of the stream is refused by its reason.
#include "server/stages/scanner/slice_guard.hpp"

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace bregma::server {
namespace {

constexpr std::int64_t kArrival_ns = 1'800'000'000'000'000'000;
constexpr std::uint64_t kWriter = 7;

struct Stream {
  std::vector<std::uint16_t> pixels = std::vector<std::uint16_t>(20, 5);
  wire::Name device{};
  std::uint64_t frame = 0;
  SliceGuard guard = [this] {
    (void)wire::set_name(device, "Scanner");
    return SliceGuard(device);
  }();

  wire::ImageSlice slice(std::uint32_t index, std::uint32_t series = 1) {
    wire::ImageSlice out{};
    (void)wire::set_name(out.device, "Scanner");
    (void)wire::set_name(out.protocol, "top");
    out.frame = ++frame;
    out.device_time_ns = kArrival_ns + static_cast<std::int64_t>(frame);
    out.T_scanner_slice = {{1, 0, 0, 0}, {0, 0, 1.5 * index}};
    out.spacing_mm[0] = out.spacing_mm[1] = 1.0;
    out.columns = 5;
    out.rows = 4;
    out.pixels._buffer = pixels.data();
    out.pixels._length = out.pixels._maximum = 20;
    out.series = series;
    out.index = index;
    out.count = 3;
    return out;
  }
  SliceVerdict check(const wire::ImageSlice &slice, std::uint64_t writer = kWriter, std::int64_t now_ns = kArrival_ns) {
    return guard.check(slice, writer, now_ns);
  }
};

TEST(SliceGuard, AcceptsSeriesAndCountsGaps) {
  Stream s;
  for (std::uint32_t i = 1; i <= 3; ++i) {
    EXPECT_TRUE(s.check(s.slice(i)).accepted);
  }
  s.frame += 2;
  EXPECT_TRUE(s.check(s.slice(2, 2)).accepted) << "another series, in any order";
  const auto health = s.guard.health(kArrival_ns);
  EXPECT_EQ(health.devices[0].taken, 4U);
  EXPECT_EQ(health.devices[0].lost, 2U);
  EXPECT_EQ(health.devices[0].status, bregma_wire_DEVICE_LIVE);
  s.guard.set_writers_alive(0);
  EXPECT_EQ(s.guard.health(kArrival_ns).devices[0].status, bregma_wire_DEVICE_LOST);
}

TEST(SliceGuard, RefusesWhatNoScannerSends) {
  struct Fault {
    const char *words;
    wire::RejectReason reason;
    std::function<void(wire::ImageSlice &)> make;
  };
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Fault> faults = {
      {"not finite", bregma_wire_REJECT_NOT_FINITE, [](auto &s) { s.T_scanner_slice.translation_mm[1] = kNaN; }},
      {"not finite", bregma_wire_REJECT_NOT_FINITE, [](auto &s) { s.spacing_mm[0] = kNaN; }},
      {"not finite", bregma_wire_REJECT_NOT_FINITE, [](auto &s) { s.table_stated = true, s.table_mm = kNaN; }},
      {"not a rotation", bregma_wire_REJECT_NOT_A_ROTATION, [](auto &s) { s.T_scanner_slice.rotation_wxyz[0] = 0.9; }},
      {"outside any scanner", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.T_scanner_slice.translation_mm[0] = 9e3; }},
      {"its size is 1 x 4", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.columns = 1; }},
      {"its size is 65536 x 65536", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.columns = s.rows = 65536; }},
      {"it has 20 pixels", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.rows = 5; }},
      {"spacing", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.spacing_mm[1] = 0.0; }},
      {"thickness", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.thickness_mm = -1.0; }},
      {"slice 4 of 3", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.index = 4; }},
      {"of series 0", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.series = 0; }},
      {"is too large", bregma_wire_REJECT_MALFORMED,
       [](auto &s) {
         static std::vector<std::uint16_t> pixels(1U << 20U);
         s.columns = s.rows = 1024;
         s.count = 129;
         s.pixels._buffer = pixels.data();
         s.pixels._length = s.pixels._maximum = 1U << 20U;
       }},
      {"negative constant", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.correction = -1; }},
      {"parallel", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.read_out = 1, s.phase_encoding = 2; }},
      {"no time", bregma_wire_REJECT_MALFORMED, [](auto &s) { s.device_time_ns = 0; }},
      {"another scanner", bregma_wire_REJECT_UNKNOWN_DEVICE, [](auto &s) { (void)wire::set_name(s.device, "Other"); }},
  };
  for (const Fault &fault : faults) {
    Stream s;
    wire::ImageSlice slice = s.slice(1);
    fault.make(slice);
    const SliceVerdict verdict = s.check(slice);
    EXPECT_FALSE(verdict.accepted) << fault.words;
    EXPECT_EQ(verdict.reason, fault.reason) << fault.words;
    EXPECT_NE(verdict.text.find(fault.words), std::string::npos) << verdict.text;
  }
}

TEST(SliceGuard, RefusesWhatDoesNotFollow) {
  Stream s;
  const wire::ImageSlice first = s.slice(1);
  EXPECT_TRUE(s.check(first).accepted);
  EXPECT_EQ(s.check(first).reason, bregma_wire_REJECT_DUPLICATE);
  EXPECT_EQ(s.check(s.slice(1)).reason, bregma_wire_REJECT_DUPLICATE) << "the same index under a new number";
  wire::ImageSlice late = s.slice(2);
  late.device_time_ns = kArrival_ns - 5;
  EXPECT_EQ(s.check(late).reason, bregma_wire_REJECT_TIME_BACKWARDS);
  EXPECT_EQ(s.check(s.slice(2), kWriter + 1).reason, bregma_wire_REJECT_DUPLICATE) << "two programs, one name";
  wire::ImageSlice restarted = s.slice(1);
  restarted.frame = 1;
  EXPECT_TRUE(s.check(restarted, kWriter + 1, kArrival_ns + 3'000'000'000).accepted) << "a restarted driver";
  EXPECT_EQ(s.guard.refused(), 4U);
}

// Whichever way the clock of scanner or daemon was set: the series under way is lost, and no other.
TEST(SliceGuard, AClockThatWasSetCostsOneSeries) {
  for (const std::int64_t step_ns : {3'600'000'000'000LL, -3'600'000'000'000LL}) {
    Stream s;
    EXPECT_TRUE(s.check(s.slice(1)).accepted);
    wire::ImageSlice second = s.slice(2);
    second.device_time_ns += step_ns;
    const SliceVerdict verdict = s.check(second);
    EXPECT_EQ(verdict.reason, step_ns > 0 ? bregma_wire_REJECT_TIME_IN_FUTURE : bregma_wire_REJECT_TIME_BACKWARDS);
    EXPECT_NE(verdict.text.find("clock was set"), std::string::npos) << verdict.text;
    for (std::uint32_t i = 1; i <= 3; ++i) {
      wire::ImageSlice next = s.slice(i, 2);
      next.device_time_ns += step_ns;
      EXPECT_TRUE(s.check(next).accepted) << i;
    }
  }
}

TEST(SliceGuard, SaysThatAnotherProgramSends) {
  Stream s;
  EXPECT_FALSE(s.check(s.slice(1)).other_writer);
  EXPECT_FALSE(s.check(s.slice(2)).other_writer);
  EXPECT_TRUE(s.check(s.slice(1), kWriter + 1, kArrival_ns + 3'000'000'000).other_writer);
  EXPECT_FALSE(s.check(s.slice(2), kWriter + 1, kArrival_ns + 3'000'000'000).other_writer);
}

TEST(SliceGuard, RefusesSlicesOfAnotherKindWithinASeries) {
  const std::vector<std::function<void(wire::ImageSlice &)>> faults = {
      [](auto &s) { s.count = 4; },
      [](auto &s) { (void)wire::set_name(s.protocol, "bottom"); },
      [](auto &s) { s.T_scanner_slice.rotation_wxyz[0] = s.T_scanner_slice.rotation_wxyz[1] = std::sqrt(0.5); },
      [](auto &s) { s.spacing_mm[0] = 2.0; },
      [](auto &s) { s.coil_state = bregma_wire_COILS_POSITIVE; },
      [](auto &s) { s.patient_position = bregma_wire_POSITION_FFS; },
      [](auto &s) { s.bandwidth_Hz_per_pixel = 260.0; },
      [](auto &s) { s.correction = bregma_wire_CORRECTION_VENDOR_2D; }};
  for (const auto &fault : faults) {
    Stream s;
    EXPECT_TRUE(s.check(s.slice(1)).accepted);
    wire::ImageSlice slice = s.slice(2);
    fault(slice);
    EXPECT_EQ(s.check(slice).reason, bregma_wire_REJECT_MALFORMED);
  }
}

} // namespace
} // namespace bregma::server
