// The line between the simulated devices and the daemon with the fault of one cell, and what happens to the daemon's
// host at the same time. It keeps the ledger of what has truly arrived.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "drivers/sim/simulated_room.hpp"
#include "tests/faults/cell.hpp"
#include "tests/faults/faulty_client.hpp"
#include "tests/faults/faulty_link.hpp"
#include "tests/faults/ledger.hpp"
#include "tests/faults/tamper.hpp"
#include "tests/support/virtual_operation.hpp"

namespace bregma::faults {

// The fault begins this long after the step of that name.
inline constexpr const char *kActivity = "activity";
inline constexpr std::int64_t kFaultAfter_ns = 2'000'000'000;

// Degraded: the tracker is silent before and after the fault's begin.
inline constexpr std::int64_t kDegradedBefore_ns = 500'000'000;
inline constexpr std::int64_t kDegradedAfter_ns = 700'000'000;

class FaultyLine final : public test::Line {
public:
  // Called with what the room has sent, unchanged.
  using Observer = std::function<void(const sim::RoomOutput &)>;

  // tool: the navigated one.
  FaultyLine(const Cell &cell, During session, const std::string &tool, std::uint64_t seed,
             test::VirtualOperation &operation);

  void carry(const sim::RoomOutput &sent, std::int64_t now_ns, test::MemoryTopics &to) override;
  [[nodiscard]] std::int64_t next_due_ns() const override;

  void observe(Observer observer) { observer_ = std::move(observer); }
  [[nodiscard]] const FaultyClient &client() const { return client_; }
  [[nodiscard]] const Ledger &ledger() const { return ledger_; }
  // 0: not yet.
  [[nodiscard]] std::int64_t begin_ns() const { return begin_ns_; }
  [[nodiscard]] std::int64_t end_ns() const { return end_ns_; }
  [[nodiscard]] bool lasts(std::int64_t now_ns) const {
    return begin_ns_ != 0 && now_ns >= begin_ns_ && now_ns < end_ns_;
  }

private:
  template <class Sample> struct Stream {
    Stream(const char *name, bool subject, const Cell &cell, const std::string &tool, std::uint64_t seed)
        : device(name), faulty(subject), tamper(cell.content, tool, cell.step_s), link(seed, name) {}
    const char *device;
    bool faulty;
    Tamper<Sample> tamper;
    FaultyLink<Sample> link;
    Sample last{};
    std::uint64_t writer = test::MemoryTopics::kWriter;
    std::map<std::uint64_t, std::int64_t> sent_ns; // by number
    bool began = false, ended = false;
  };

  void begin();
  void end();
  void host(std::int64_t now_ns);
  template <class Sample> void send(Stream<Sample> &stream, Sample sample, std::int64_t now_ns);
  void send_foreign(const wire::TrackerFrame &frame, std::int64_t now_ns);
  template <class Sample> void deliver(Stream<Sample> &stream, std::int64_t now_ns, test::MemoryTopics &to);
  [[nodiscard]] bool is_foreign(std::uint64_t writer) const;
  void record(const FaultyLink<wire::TrackerFrame>::Packet &packet);
  template <class Packet> void record(const Packet & /*of a stream without poses*/) {}
  [[nodiscard]] const LinkFault *link_fault(bool faulty, bool tracker, std::int64_t now_ns) const;

  Cell cell_;
  During session_;
  std::string tool_;
  test::VirtualOperation &operation_;
  Stream<wire::TrackerFrame> tracker_;
  Stream<wire::RobotState> robot_;
  Stream<wire::ForceSample> force_;
  Stream<wire::RangeSample> range_;
  FaultyLink<wire::Command> commands_;
  FaultyClient client_;
  Observer observer_;
  Ledger ledger_;
  std::map<std::uint64_t, std::int64_t> exposures_; // of the room's frames
  std::int64_t frozen_exposure_ns_ = 0;
  std::uint64_t renumbered_by_ = 0; // the room's number minus that of the restarted tracker
  std::int64_t begin_ns_ = 0, end_ns_ = 0;
  bool host_began_ = false, host_ended_ = false;
  bool was_running_ = true, daemon_killed_ = false;
};

} // namespace bregma::faults
