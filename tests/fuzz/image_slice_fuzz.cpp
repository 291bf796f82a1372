// Arbitrary bytes as slices of a scanner: nothing crashes, every slice is accepted, or rejected with a sentence, and
// accepted slices satisfy the guarantees of the input check; a stack of them can be assembled.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <vector>

#include "idl/names.hpp"
#include "server/stages/scanner/slice_guard.hpp"
#include "server/stages/scanner/slice_stack.hpp"
#include "tests/fuzz/fuzzer_bytes.hpp"

namespace {

using namespace bregma;

constexpr std::int64_t kBegin_ns = 1'700'000'000'000'000'000;
constexpr std::uint32_t kManyPixels = 64; // of a slice that is made plausible

using fuzz::require;

void require_usable(const wire::ImageSlice &slice) {
  require(wire::is_terminated(slice.device) && wire::is_terminated(slice.protocol));
  const Eigen::Matrix3d axes = server::axes_of(slice);
  require((axes * axes.transpose()).isIdentity(1e-6));
  require(Eigen::Vector3d::Map(slice.T_scanner_slice.translation_mm).allFinite());
  require(slice.spacing_mm[0] > 0.0 && slice.spacing_mm[1] > 0.0 && slice.thickness_mm >= 0.0);
  require(slice.pixels._length == slice.columns * slice.rows && slice.pixels._buffer != nullptr);
  require(slice.index >= 1 && slice.index <= slice.count && slice.count <= server::SliceGuard::kMaxSlices);
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  fuzz::Bytes bytes(data, size);
  wire::Name device{};
  static_cast<void>(wire::set_name(device, "D"));
  server::SliceGuard guard(device);
  std::int64_t now_ns = kBegin_ns;
  std::uint64_t sent = 0, unknown = 0;
  std::vector<std::uint16_t> pixels(kManyPixels * kManyPixels, 100);
  std::optional<server::SliceStack> stack;
  while (!bytes.empty()) {
    // The first byte selects the fields that are made plausible, so that the fuzzer passes the first rule.
    const auto plan = bytes.take<std::uint8_t>();
    now_ns += bytes.take<std::uint16_t>() * std::int64_t{1'000};
    auto slice = bytes.take<wire::ImageSlice>();
    slice.pixels = {};       // a pointer of the fuzzer's
    std::uint8_t stated = 0; // Cyclone refuses booleans other than 0 and 1
    std::memcpy(&stated, &slice.table_stated, sizeof stated);
    slice.table_stated = (stated & 1U) != 0;
    slice.pixels._buffer = (plan & 1U) != 0 ? pixels.data() : nullptr;
    slice.pixels._length = slice.pixels._maximum = (plan & 1U) != 0 ? slice.columns % 4096 : 0;
    if ((plan & 2U) != 0) {
      static_cast<void>(wire::set_name(slice.device, "D"));
      static_cast<void>(wire::set_name(slice.protocol, "p"));
    }
    if ((plan & 4U) != 0) {
      slice.columns = 2 + slice.columns % (kManyPixels - 1);
      slice.rows = 2 + slice.rows % (kManyPixels - 1);
      slice.pixels._buffer = pixels.data();
      slice.pixels._length = slice.pixels._maximum = slice.columns * slice.rows;
      slice.count = 1 + slice.count % 16;
      slice.index = 1 + slice.index % slice.count;
      slice.series = 1 + slice.series % 3;
    }
    if ((plan & 8U) != 0) {
      slice.T_scanner_slice = {{1, 0, 0, 0}, {0, 0, static_cast<double>(slice.index)}};
      slice.spacing_mm[0] = slice.spacing_mm[1] = slice.thickness_mm = 1.0;
      slice.bandwidth_Hz_per_pixel = slice.coil_current_mA = slice.table_mm = 0.0;
    }
    if ((plan & 16U) != 0) {
      slice.frame = sent + 1;
      slice.device_time_ns = now_ns;
      slice.phase_encoding = slice.read_out = bregma_wire_DIRECTION_UNKNOWN;
      slice.coil_state = slice.patient_position = slice.correction = 1;
    }
    const server::SliceVerdict verdict = guard.check(slice, plan >> 7U, now_ns);
    ++sent;
    unknown += !verdict.accepted && verdict.reason == bregma_wire_REJECT_UNKNOWN_DEVICE ? 1 : 0;
    require(verdict.accepted || !verdict.text.empty());
    if (!verdict.accepted) {
      continue;
    }
    require_usable(slice);
    if (!stack || stack->series() != slice.series) {
      stack.emplace(slice);
    } else {
      static_cast<void>(stack->add(slice));
    }
    if (stack->complete()) {
      static_cast<void>(stack->stack());
    }
  }
  require(guard.taken() + guard.refused() + unknown == sent);
  return 0;
}
