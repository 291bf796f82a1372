// Hosts on one Ethernet, for tests of faults of the network: each host is a network namespace with a tap device, and a
// switch in user space passes frames between them. The links of the switch can be cut, delayed and disturbed.
//
// Threads: any may call. The switch has one thread of its own. Errors: the constructor throws std::system_error.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace bregma::test {

// Of the link between a host and the switch, in both directions. Probabilities are per frame.
struct LinkFault {
  bool cut = false;
  std::chrono::milliseconds delay{0};
  double loss = 0.0;
  double reordering = 0.0; // held back for 5 ms, while later frames pass
  double duplication = 0.0;
};

class Ethernet {
public:
  // Why this process cannot make hosts; empty if it can.
  [[nodiscard]] static std::string unavailable();

  // Addresses 10.77.0.1, 10.77.0.2, ...; the seed is that of the frames which are lost, held back or duplicated.
  Ethernet(std::size_t hosts, std::uint64_t seed);
  ~Ethernet();
  Ethernet(const Ethernet &) = delete;
  Ethernet &operator=(const Ethernet &) = delete;

  void set_fault(std::size_t host, const LinkFault &fault);
  // Runs the job on a thread of the host. Sockets that it opens, and processes and threads that it starts, belong to
  // the host.
  void run_on(std::size_t host, const std::function<void()> &job);

private:
  class Switch;
  std::unique_ptr<Switch> switch_;
};

} // namespace bregma::test
