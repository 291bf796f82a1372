// Commands of a faulty client, and what the daemon must answer.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "idl/topics.hpp"
#include "tests/faults/cell.hpp"

namespace bregma::faults {

class FaultyClient {
public:
  explicit FaultyClient(ClientFault fault) : fault_(fault) {}

  // What the client sends now. Times of the fault; 0: not known yet.
  [[nodiscard]] std::vector<wire::Command> commands(std::int64_t now_ns, std::int64_t begin_ns, std::int64_t end_ns);

  // Number of commands that must be answered, each once: by id, kind and the time at which it was sent.
  struct Asked {
    std::uint64_t id;
    wire::CommandKind kind;
    std::int64_t sent_ns;
  };
  [[nodiscard]] const std::vector<Asked> &asked() const { return asked_; }
  static constexpr const char *kName = "faulty";

private:
  [[nodiscard]] wire::Command command(wire::CommandKind kind, std::initializer_list<std::string_view> values,
                                      std::int64_t now_ns);
  void ask(std::vector<wire::Command> &out, const wire::Command &command, std::int64_t now_ns);
  void ask_malformed(std::vector<wire::Command> &out, std::int64_t now_ns);
  void ask_unknown_names(std::vector<wire::Command> &out, std::int64_t now_ns);
  void ask_same_id(std::vector<wire::Command> &out, std::int64_t now_ns);

  ClientFault fault_;
  std::vector<Asked> asked_;
  std::uint64_t last_id_ = 0;
  std::int64_t next_ns_ = 0;
};

} // namespace bregma::faults
