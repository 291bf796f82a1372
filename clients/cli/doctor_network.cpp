#include "clients/cli/doctor_network.hpp"

#include <algorithm>
#include <fstream>
#include <string>
#include <system_error>

#include "idl/dds.hpp"

namespace bregma::cli {

using runtime::Fitness;
using runtime::RealtimeCheck;

RealtimeCheck check_send_buffer(std::uint32_t domain) {
  const std::string name = "DDS send buffer";
  try {
    const dds::Participant participant(domain);
    const auto bytes = dds::send_buffer_bytes();
    const std::string advice = dds::send_buffer_advice(bytes);
    return {name, advice.empty() ? Fitness::kGood : Fitness::kLimited,
            bytes ? std::to_string(*bytes / 1024) + " KiB" : "DDS uses no UDP socket", advice};
  } catch (const dds::Error &error) {
    return {name, Fitness::kBad, error.what(), "see CYCLONEDDS_URI"};
  }
}

RealtimeCheck check_unresolved_queue(const std::filesystem::path &neighbours) {
  // The packets kept for a silent host count against the sender's buffer: four such hosts must fit.
  constexpr std::size_t kMaxBytes = dds::kSendBufferBytes / 4;
  RealtimeCheck out{"packets for silent hosts", Fitness::kGood, "", ""};
  std::size_t largest = 0;
  std::error_code error;
  for (const auto &entry : std::filesystem::directory_iterator(neighbours, error)) {
    const std::string interface = entry.path().filename().string();
    std::size_t bytes = 0;
    if (interface == "lo" || !(std::ifstream(entry.path() / "unres_qlen_bytes") >> bytes)) {
      continue;
    }
    largest = std::max(largest, bytes);
    if (bytes > kMaxBytes) {
      out.fitness = Fitness::kLimited;
      out.advice += (out.advice.empty() ? "" : ", ") + ("net.ipv4.neigh." + interface) + ".unres_qlen_bytes=212992";
    }
  }
  if (largest == 0) {
    return {out.name, Fitness::kLimited, "the kernel's limit is not known", ""};
  }
  out.finding = "at most " + std::to_string(largest / 1024) + " KiB are kept for each";
  if (!out.advice.empty()) {
    out.finding += ": four of them fill the send buffer, and then every writer stops";
    out.advice = "set sysctl " + out.advice;
  }
  return out;
}

} // namespace bregma::cli
