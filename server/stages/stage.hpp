// A stage is one part of the daemon with its own thread. It owns its inputs, parameters, outputs and state, and has one
// step. Only server/wiring.cpp defines what a stage reads from others. docs/new-stage.md shows how to write one.
//
// A stage class has, in addition to the members below:
//   static constexpr const char *kName;            // at most 15 bytes; thread, health, recorder channel
//   using Parameters = ...;                        // a struct with defaults, and next to it
//                                                  // void declare(base ParameterSet &, Parameters &)
//   Stage(const Parameters &, const StageContext &) // throws std::invalid_argument, dds::Error
//   void connect(outputs of other stages...);      // if it reads any
//   public outputs: runtime::LatestValue, runtime::SpscRing, runtime::Mailbox, CaseStore
//
// Threads: the main thread constructs and connects; then only the stage's thread calls step() and wake_ns().
#pragma once

#include <cstdint>
#include <limits>

namespace bregma::server {

class Host;
class Link;

// Times of a step.
struct Moment {
  std::int64_t utc_ns = 0;             // steady UTC (docs/time.md): boot_ns plus a constant; all ages and alarms
  std::int64_t monotonic_ns = 0;       // never steps; rates and deadlines
  std::int64_t boot_ns = 0;            // never steps, and continues during suspend
  std::int64_t wall_minus_boot_ns = 0; // changes only by steps of the wall clock
  std::int64_t wall_error_ns = 0;      // maximal error of the wall clock; 0: not synchronised
  bool tick = true;                    // the step is due by the rate; false: triggered by a sample or wake_ns()

  // The wall clock minus steady UTC: the sum of its steps since the start.
  [[nodiscard]] std::int64_t wall_lead_ns() const noexcept { return wall_minus_boot_ns + boot_ns - utc_ns; }
};

enum class ThreadClass : std::uint8_t {
  kFifo,  // SCHED_FIFO with the stage's priority (0: the default scheduler). step() never allocates, locks or logs.
  kBatch, // computes for most of its period: SCHED_BATCH. step() never allocates, locks or logs.
  kWorker // may allocate, lock, log and wait for the disk
};

struct Schedule {
  ThreadClass thread = ThreadClass::kFifo;
  int fifo_priority = 0;
  double rate_hz = 0.0; // absolute deadlines, overruns counted and skipped; 0: the stage is not started
  // Also stepped when a sample arrives on a topic that it reads.
  bool triggered = false;
  // A worker that may be busy for seconds: SCHED_BATCH, without a watchdog.
  bool long_work = false;
};

// Environment of a stage, passed to its constructor.
struct StageContext {
  Link &link; // its topics (server/stages/ports.hpp)
  Host &host; // the process around it (server/stages/host.hpp)
};

class Stage {
public:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

  Stage(const char *name, const Schedule &schedule) : name_(name), schedule_(schedule) {}
  virtual ~Stage() = default;
  Stage(const Stage &) = delete;
  Stage &operator=(const Stage &) = delete;

  [[nodiscard]] const char *name() const noexcept { return name_; }
  [[nodiscard]] const Schedule &schedule() const noexcept { return schedule_; }

  // Once, on the main thread, before the first step of any stage: what the last run left behind.
  virtual void begin(const Moment & /*now*/) {}
  // Takes in what has arrived, brings the state up to now, and publishes.
  virtual void step(const Moment &now) noexcept = 0;
  // Monotonic time at which the stage must be stepped because its output changes without a sample.
  [[nodiscard]] virtual std::int64_t wake_ns(const Moment & /*now*/) const noexcept { return kNever; }
  // A longer step is an overrun; 0: only the limit of the rate.
  [[nodiscard]] virtual std::int64_t budget_ns() const noexcept { return 0; }

private:
  const char *name_;
  Schedule schedule_;
};

} // namespace bregma::server
