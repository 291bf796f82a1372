// A client that shows the probe by the rule for live poses (idl/validity.hpp), on a host of an Ethernet. It records
// what it received and what it showed, to be compared with the truth.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "tests/network/ethernet.hpp"

namespace bregma::test {

// A period of a display. Times: ns UTC, common to all hosts of an Ethernet.
struct DisplayRecord {
  std::int64_t time_ns;
  std::uint32_t arrived;                    // states of the probe since the last record
  std::optional<std::uint64_t> shown_frame; // the frame of the pose that is shown
};

class Display {
public:
  Display(Ethernet &lan, std::size_t host, std::uint32_t domain);
  ~Display();
  Display(const Display &) = delete;
  Display &operator=(const Display &) = delete;

  [[nodiscard]] bool shows() const { return shows_; }
  // Since the last call.
  [[nodiscard]] std::vector<DisplayRecord> take_records();

private:
  void run(std::uint32_t domain);

  std::mutex mutex_; // of the records
  std::vector<DisplayRecord> records_;
  std::atomic<bool> shows_{false};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

// Exposure of every frame, as the simulated room states it; on the room's host.
class Truth {
public:
  Truth(Ethernet &lan, std::size_t host, std::uint32_t domain);
  ~Truth();
  Truth(const Truth &) = delete;
  Truth &operator=(const Truth &) = delete;

  [[nodiscard]] std::optional<std::int64_t> exposed_ns(std::uint64_t frame) const;

private:
  void run(std::uint32_t domain);

  mutable std::mutex mutex_; // of the times
  std::map<std::uint64_t, std::int64_t> exposed_ns_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

} // namespace bregma::test
