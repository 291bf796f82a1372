// Other daemons on the domain, from their SystemHealth. Threads: one at a time. The constructor throws dds::Error.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>

#include "idl/dds.hpp"

namespace bregma::server {

class OtherDaemons {
public:
  // own_run_id: SystemHealth::run_id of this process.
  OtherDaemons(const dds::Participant &participant, std::uint64_t own_run_id);

  // Reads what has arrived. The daemons heard within the last kPresent_ns, as "process 4711 on or-3", separated by
  // commas; empty if there is none. Only a process that runs is heard: the last sample of a killed one is not sent.
  [[nodiscard]] std::string heard(std::int64_t monotonic_ns);
  // Waits until another daemon is heard, or for this time. A running daemon answers a new participant at once.
  [[nodiscard]] std::string listen(std::chrono::nanoseconds limit);

  static constexpr std::int64_t kPresent_ns = 3'000'000'000; // more than the period of the slowest health topic

private:
  dds::Reader<wire::SystemHealth> reader_;
  dds::WaitSet wait_;
  std::uint64_t own_run_id_;
  std::map<std::string, std::int64_t> heard_ns_; // per name
};

} // namespace bregma::server
