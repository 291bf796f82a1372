#include "idl/dds_process.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <mutex>
#include <system_error>
#include <utility>

#include <dds/dds.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

namespace bregma::dds {
namespace {

std::atomic<std::uint64_t> ill_typed{0};

// A pipe with room for PIPE_BUF bytes takes a line of that size without blocking.
void write_to_stderr(Severity severity, std::string_view line) {
  pollfd out{STDERR_FILENO, POLLOUT, 0};
  if (poll(&out, 1, 0) != 1 || (out.revents & POLLOUT) == 0) {
    return;
  }
  std::array<char, 1024> text;
  constexpr std::string_view kPrefix[] = {"dds: ", "dds: warning: ", "dds: error: "};
  const std::string_view prefix = kPrefix[static_cast<std::size_t>(severity)];
  std::size_t length = prefix.copy(text.data(), text.size());
  length += line.copy(text.data() + length, text.size() - length - 1);
  text[length++] = '\n';
  (void)!write(STDERR_FILENO, text.data(), length);
}

Log &current_log() {
  static Log log = write_to_stderr;
  return log;
}

// Malformed packets can cause a message each: what exceeds the limit of a second is dropped.
bool may_log() {
  constexpr std::uint32_t kPerSecond = 20;
  static std::atomic<std::int64_t> second{0};
  static std::atomic<std::uint32_t> count{0};
  const std::int64_t now =
      std::chrono::duration_cast<std::chrono::seconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
  if (second.exchange(now) != now) {
    const std::uint32_t all = count.exchange(0);
    if (all > kPerSecond) {
      log(Severity::kWarning, std::to_string(all - kPerSecond) + " more messages were dropped");
    }
  }
  return count.fetch_add(1) < kPerSecond;
}

void on_message(void * /*unused*/, const dds_log_data_t *data) {
  std::string_view text(data->message, data->size); // without the header of a trace
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) {
    text.remove_suffix(1);
  }
  if (may_log()) {
    log((data->priority & (DDS_LC_FATAL | DDS_LC_ERROR)) != 0 ? Severity::kError
        : (data->priority & DDS_LC_WARNING) != 0              ? Severity::kWarning
                                                              : Severity::kInfo,
        text);
  }
  // "data(application, vendor 1.16): GUID #1: deserialization TrackerFrame/bregma::wire::TrackerFrame failed (...)",
  // and from a writer of this process "local: deserialization bregma::wire::TrackerFrame failed in type conversion"
  if (text.find("deserialization") != std::string_view::npos) {
    ill_typed.fetch_add(1, std::memory_order_release);
  }
}

dds_entity_t create_domain(std::uint32_t domain_id, Role role) {
  dds_set_log_sink(on_message, nullptr); // Cyclone would write to standard error itself, on its receive threads
  dds_entity_t domain = dds_create_domain(domain_id, configuration(role).c_str());
  if (domain < 0 && role == Role::kServer) {
    domain = dds_create_domain(domain_id, configuration(Role::kClient).c_str());
    if (domain >= 0) {
      log(Severity::kWarning, "no port is free that peers know: programs find this one only by multicast");
    }
  }
  if (domain < 0) {
    throw Error("DDS: cannot configure domain " + std::to_string(domain_id) + ": " + dds_strretcode(domain));
  }
  return domain;
}

} // namespace

const char *default_configuration() {
  return "<CycloneDDS><Domain>"
         "<General><Interfaces><NetworkInterface name=\"lo\" multicast=\"true\"/></Interfaces>"
         "<AllowMulticast>spdp</AllowMulticast></General>"
         "<Discovery><ParticipantIndex>none</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
         "<Peers><Peer Address=\"127.0.0.1\"/></Peers></Discovery>"
         "</Domain></CycloneDDS>";
}

std::string configuration(Role role) {
  const char *uri = std::getenv("CYCLONEDDS_URI"); // NOLINT(concurrency-mt-unsafe): read before threads start
  // Later settings override earlier ones: buffer and intervals are only defaults, the role is not. A reliable sample
  // that was lost is noticed with the next heartbeat: Cyclone's own default is 100 ms.
  return "<CycloneDDS><Domain><Discovery><SPDPInterval>1s</SPDPInterval></Discovery><Internal>"
         "<HeartbeatInterval>20ms</HeartbeatInterval><SocketSendBufferSize max=\"" +
         std::to_string(kSendBufferBytes) + "B\"/></Internal></Domain></CycloneDDS>," +
         (uri != nullptr && *uri != '\0' ? uri : default_configuration()) +
         (role == Role::kServer ? ",<CycloneDDS><Domain><Discovery><ParticipantIndex>auto</ParticipantIndex>"
                                  "</Discovery></Domain></CycloneDDS>"
                                : "");
}

std::shared_ptr<void> use_domain(std::uint32_t domain_id, Role role) {
  struct Domain {
    dds_entity_t handle;
    int users;
  };
  static std::mutex mutex;
  static std::map<std::uint32_t, Domain> domains;
  const std::lock_guard lock(mutex);
  const auto found = domains.find(domain_id);
  Domain &domain = found != domains.end()
                       ? found->second
                       : domains.emplace(domain_id, Domain{create_domain(domain_id, role), 0}).first->second;
  ++domain.users;
  return {nullptr, [domain_id](void *) {
            const std::lock_guard last(mutex);
            const auto used = domains.find(domain_id);
            if (--used->second.users == 0) {
              (void)dds_delete(used->second.handle);
              domains.erase(used);
            }
          }};
}

void set_log(Log log) { current_log() = std::move(log); }

void log(Severity severity, std::string_view line) noexcept { current_log()(severity, line); }

std::uint64_t ill_typed_samples() noexcept { return ill_typed.load(std::memory_order_acquire); }

std::optional<std::size_t> send_buffer_bytes() {
  std::optional<std::size_t> smallest;
  std::error_code error;
  for (const auto &entry : std::filesystem::directory_iterator("/proc/self/fd", error)) {
    const int file = std::atoi(entry.path().filename().c_str());
    const auto option = [file](int name) {
      int value = -1;
      socklen_t length = sizeof value;
      return getsockopt(file, SOL_SOCKET, name, &value, &length) == 0 ? value : -1;
    };
    const int family = option(SO_DOMAIN);
    if (option(SO_TYPE) == SOCK_DGRAM && (family == AF_INET || family == AF_INET6)) {
      const auto bytes = static_cast<std::size_t>(option(SO_SNDBUF)) / 2; // the kernel doubles it for its own data
      smallest = std::min(smallest.value_or(bytes), bytes);
    }
  }
  return smallest;
}

std::string send_buffer_advice(std::optional<std::size_t> bytes) {
  if (!bytes || *bytes >= kSendBufferBytes) {
    return {};
  }
  return "DDS sends with a buffer of " + std::to_string(*bytes / 1024) + " KiB, which is less than " +
         std::to_string(kSendBufferBytes / 1024) +
         " KiB: a host that vanishes would stop every writer for seconds; set net.core.wmem_max (bregma-sysctl.conf), "
         "and SocketSendBufferSize where CYCLONEDDS_URI sets it";
}

} // namespace bregma::dds
