// Checks of `bregma doctor` on the network's settings: whether a host that vanishes can stop this one's writers.
#pragma once

#include <cstdint>
#include <filesystem>

#include "server/runtime/realtime.hpp"

namespace bregma::cli {

// The send buffer that a participant of this domain gets.
[[nodiscard]] runtime::RealtimeCheck check_send_buffer(std::uint32_t domain);

// The packets that the kernel keeps for each host that does not answer ARP requests, per interface.
// neighbours: /proc/sys/net/ipv4/neigh, or a copy of its folders.
[[nodiscard]] runtime::RealtimeCheck check_unresolved_queue(const std::filesystem::path &neighbours);

} // namespace bregma::cli
