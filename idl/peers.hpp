// Who else is on the domain, and which wire it speaks: from what every participant announces in its USER_DATA and from
// the topics that its endpoints use. Types of another generation do not match, so that without this both sides would
// see silence and no reason for it.
//
// Threads: one at a time. Errors: the constructor throws dds::Error; update() never throws for what is on the wire.
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
  std::optional<wire::WireVersion> version; // nothing: it states none
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

  // Takes in who has come and gone.
  void update();
  // Participants that write or read a topic of the table (idl/topics.hpp) but not in this program's generation.
  [[nodiscard]] std::vector<Peer> of_another_wire() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// "bregmad speaks wire 3.0, this program speaks wire 2.0: install one release on both"; empty without peers.
[[nodiscard]] std::string other_wire_text(const std::vector<Peer> &peers);

} // namespace bregma::dds
