// Endpoints that found each other by their topic but do not exchange samples, because their quality of service or their
// type differs. Each is also reported in the process's log (dds_process.hpp) when it is found, on both sides.
//
// Threads: any. Errors: the constructor throws dds::Error.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

namespace bregma::dds {

struct Mismatch {
  std::string topic;
  std::string policy; // "deadline", "type", ...
  bool writer;        // the end of this program: it writes the topic

  // "TrackerFrame: a writer offers less than this program requires (deadline)"
  [[nodiscard]] std::string text() const;
  friend bool operator<(const Mismatch &a, const Mismatch &b) {
    return std::tie(a.topic, a.policy, a.writer) < std::tie(b.topic, b.policy, b.writer);
  }
};

class Mismatches {
public:
  // participant: a Cyclone handle. Endpoints made from now on are followed.
  explicit Mismatches(std::int32_t participant);
  ~Mismatches();
  Mismatches(const Mismatches &) = delete;
  Mismatches &operator=(const Mismatches &) = delete;

  // The topic of an endpoint that was just made. Cyclone can report its mismatches before it is known by its handle.
  void name(std::int32_t endpoint, const char *topic) const;

  // Found so far, each once, in the order of topics. The other end may have gone since.
  [[nodiscard]] std::vector<Mismatch> found() const;
  [[nodiscard]] std::string text() const; // all of them, separated by "; "; empty: none

private:
  struct Table;
  std::int32_t participant_;
  std::unique_ptr<Table> table_;
};

} // namespace bregma::dds
