// The wall clock of this host against CLOCK_BOOTTIME, and what a driver states of both when it writes (docs/time.md).
//
// CLOCK_BOOTTIME follows the rate of the time service, not its steps; the wall clock (CLOCK_REALTIME) may step.
//
// Threads: any. No allocation, locks or exceptions.
#pragma once

#include <array>
#include <cstdint>

#include "idl/boot_clock.hpp"

namespace bregma::wire {

using BootIdentity = std::array<std::uint8_t, 16>; // BootId of streams.idl as a value; all 0: not stated

// The clocks of a driver's host when it wrote a sample: fields of the wire.
struct WriteTime {
  BootIdentity boot_id{};
  std::int64_t boot_ns = 0;       // CLOCK_BOOTTIME; 0: not stated
  std::int64_t wall_ns = 0;       // may step
  std::int64_t wall_error_ns = 0; // maximal error stated by the time service; 0: not synchronised
};

[[nodiscard]] std::int64_t monotonic_now_ns() noexcept;

// The wall clock minus CLOCK_BOOTTIME, constant between steps. Both are read within microseconds of each other, or, on
// a very busy processor, in the best of several attempts.
[[nodiscard]] std::int64_t wall_minus_boot_ns() noexcept;

// Maximal error of the wall clock against UTC as stated by the time service (adjtimex); 0: not synchronised. A call of
// the system, about 1 µs.
[[nodiscard]] std::int64_t wall_clock_error_ns() noexcept;

} // namespace bregma::wire
