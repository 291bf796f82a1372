// Other participants on the domain and their wire version, from their USER_DATA and the topics of their endpoints.
// Types of another generation do not match, so without this check both sides would receive no data for no visible
// reason.
//
// Threads: one at a time. Errors: the constructor throws dds::Error. update() does not throw for any received data.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "idl/dds.hpp"

namespace bregma::dds {

struct Peer {
  std::string program;                      // empty: not stated
  std::optional<wire::WireVersion> version; // empty: not stated
  bool is_daemon = false;                   // it writes SystemHealth

  // "bregmad speaks wire 3.0"; "a program that states no wire version is here".
  [[nodiscard]] std::string text() const;
};

class Peers {
public:
  explicit Peers(const Participant &participant);
  ~Peers();
  Peers(const Peers &) = delete;
  Peers &operator=(const Peers &) = delete;

  // Updates the list of participants.
  void update();
  // Participants that write or read a topic of the table (idl/topics.hpp) but not in this program's generation.
  [[nodiscard]] std::vector<Peer> of_another_wire() const;
  // The program that a participant announces, short and printable; empty: not stated, or unknown participant.
  [[nodiscard]] std::string program_of(const Guid &participant) const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// "bregmad speaks wire 3.0, this program speaks wire 2.0: install one release on both"; empty without peers.
[[nodiscard]] std::string other_wire_text(const std::vector<Peer> &peers);

} // namespace bregma::dds
