// What all DDS participants of a process have in common: Cyclone's configuration, its log, and its sockets.
//
// Threads: set_log() before the first participant, the others at any time. Errors: use_domain() throws dds::Error.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

namespace bregma::dds {

class Error : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

// How others find a participant without multicast, by the first participant of a process. With multicast all find each
// other, whatever they are.
enum class Role : std::uint8_t {
  kClient, // any free port: any number of clients, and none takes a port from a daemon
  kServer  // a port known by its number, which is tried on every peer: the daemon, and drivers
};

inline constexpr std::size_t kSendBufferBytes = std::size_t{4} << 20;

// Cyclone's settings without CYCLONEDDS_URI: loopback only. A network must be configured explicitly.
[[nodiscard]] const char *default_configuration();
// Everything that Cyclone is given: the file or text of CYCLONEDDS_URI, or default_configuration(), with send
// buffer and discovery interval if it states none, and with the role.
[[nodiscard]] std::string configuration(Role role);

// Cyclone's settings of a domain can be set only once, before its first participant; the first user states the role.
// The result keeps the domain, with its threads and plug-ins; it ends with the last of its users.
[[nodiscard]] std::shared_ptr<void> use_domain(std::uint32_t domain_id, Role role);

enum class Severity : std::uint8_t { kInfo, kWarning, kError };
// Called on any thread, Cyclone's receive threads included: it must not block or throw.
using Log = std::function<void(Severity, std::string_view line)>;
// Receives Cyclone's own messages and those about mismatches. The default writes them to standard error and drops a
// line rather than wait for a reader of that.
void set_log(Log log);
void log(Severity severity, std::string_view line) noexcept;

// Samples received so far that do not fit their topic's type; Cyclone drops them.
[[nodiscard]] std::uint64_t ill_typed_samples() noexcept;

// The smallest send buffer of the process's UDP sockets, as requested; empty without such sockets. A buffer that holds
// the packets for hosts which do not answer ARP requests keeps writers from blocking for seconds (docs/network.md).
[[nodiscard]] std::optional<std::size_t> send_buffer_bytes();
// Empty if that is enough, else the finding and what to set.
[[nodiscard]] std::string send_buffer_advice(std::optional<std::size_t> bytes);

} // namespace bregma::dds
