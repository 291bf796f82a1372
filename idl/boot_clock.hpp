// The clock that validity is counted with: CLOCK_BOOTTIME, which never steps and continues during suspend.
//
// Threads: any.
#pragma once

#include <array>
#include <cstdint>

namespace bregma::wire {

// Neither allocates nor fails.
[[nodiscard]] std::int64_t boot_now_ns() noexcept;

// Identity of the machine's current boot (BootId of streams.idl): times of CLOCK_BOOTTIME can be compared only for
// equal identities. All 0 if the system does not provide it. Reads a file.
[[nodiscard]] std::array<std::uint8_t, 16> boot_id();

} // namespace bregma::wire
