// Answers requests for the files of the case that is offered: the side of bregma-case-server.
//
// Chunks are sent one at a time with pauses, because on their way to the network they share queues with the states of
// the daemon, which must not wait behind a burst.
//
// Threads: one object, one thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <string>
#include <vector>

#include "casefile/sha256.hpp"
#include "idl/dds.hpp"

namespace bregma::casefiles {

// The files of a case in memory, and the manifest that lists them.
struct Bundle {
  std::string case_id;
  std::string manifest;                                   // JSON, see docs/gateway.md
  std::map<casefile::Hash, std::vector<std::byte>> files; // without the manifest
};

class CaseSender {
public:
  CaseSender(const dds::Participant &participant, std::string server);

  void offer_none();
  void offer_preparing(const std::string &case_id);
  void offer_failed(const std::string &case_id, const std::string &why);
  void offer(Bundle bundle);

  // Takes requests and sends what was asked for, for this time.
  void serve(std::chrono::nanoseconds timeout);

  [[nodiscard]] std::uint64_t sent_chunks() const { return sent_chunks_; }
  // Asked for when the queue was full. A display asks again for what does not arrive.
  [[nodiscard]] std::uint64_t dropped_chunks() const { return dropped_chunks_; }

private:
  void publish(wire::CaseOfferState state, const std::string &case_id, const std::string &text);
  struct Wanted {
    casefile::Hash file{};
    std::uint64_t chunk = 0;
    wire::Name client{}; // the first that asked for it
  };
  using Clock = std::chrono::steady_clock;
  void enqueue(const wire::CaseRequest &request);
  void send(const Wanted &wanted);

  std::string server_;
  dds::Writer<wire::CaseOffer> offers_;
  dds::Reader<wire::CaseRequest> requests_;
  dds::Writer<wire::CaseChunk> chunks_;
  dds::WaitSet wait_;
  casefile::Hash manifest_{};
  std::uint64_t manifest_bytes_ = 0;
  std::map<casefile::Hash, std::vector<std::byte>> files_; // with the manifest
  std::deque<Wanted> queue_;
  Clock::time_point next_{}; // when the next chunk may be sent
  std::uint64_t sent_chunks_ = 0;
  std::uint64_t dropped_chunks_ = 0;
};

} // namespace bregma::casefiles
