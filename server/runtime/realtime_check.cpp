// The checks of check_realtime(). All values are read from the kernel, and no setting remains changed.
#include <fstream>
#include <future>
#include <string>
#include <sys/resource.h>
#include <sys/timex.h>
#include <sys/utsname.h>
#include <thread>

#include "server/runtime/realtime.hpp"

namespace bregma::runtime {
namespace {

// The first line of a file of /proc or /sys; empty when it cannot be read.
std::string first_line(const std::string &file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

long number(const std::string &file, long otherwise) {
  std::ifstream in(file);
  long value = 0;
  return in >> value ? value : otherwise;
}

std::string limit_text(rlim_t limit) { return limit == RLIM_INFINITY ? "unlimited" : std::to_string(limit); }

RealtimeCheck check_fifo() {
  // In a temporary thread, so that the caller's scheduling does not change.
  const auto problems =
      std::async(std::launch::async, [] { return set_up_thread({.name = "fifo-check", .fifo_priority = 80}); }).get();
  if (problems.empty()) {
    return {"fifo", Fitness::kGood, "SCHED_FIFO up to priority 80 is allowed", ""};
  }
  rlimit limit{};
  getrlimit(RLIMIT_RTPRIO, &limit);
  return {"fifo", Fitness::kBad, "SCHED_FIFO is refused (rtprio limit " + limit_text(limit.rlim_cur) + ")",
          "set LimitRTPRIO=90 in the service unit, or rtprio in /etc/security/limits.d"};
}

RealtimeCheck check_memory_lock() {
  const std::string amount = std::to_string(kLockedBytes >> 20) + " MiB";
  if (may_lock(kLockedBytes)) {
    return {"memory lock", Fitness::kGood, amount + " may be locked", ""};
  }
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  return {"memory lock", Fitness::kBad, amount + " may not be locked (limit " + limit_text(limit.rlim_cur) + " bytes)",
          "set LimitMEMLOCK=infinity in the service unit, or memlock in /etc/security/limits.d"};
}

RealtimeCheck check_throttling() {
  const long runtime_us = number("/proc/sys/kernel/sched_rt_runtime_us", 950'000);
  const long period_us = number("/proc/sys/kernel/sched_rt_period_us", 1'000'000);
  if (runtime_us < 0) {
    return {"throttling", Fitness::kGood, "real-time threads are never throttled", ""};
  }
  const std::string found = "real-time threads may use " + std::to_string(runtime_us / 1000) + " ms of every " +
                            std::to_string(period_us / 1000) + " ms";
  if (runtime_us * 2 < period_us) {
    return {"throttling", Fitness::kLimited, found, "set sysctl kernel.sched_rt_runtime_us=950000"};
  }
  return {"throttling", Fitness::kGood, found, ""};
}

RealtimeCheck check_kernel() {
  utsname system{};
  uname(&system);
  const std::string release = std::string(system.release);
  const std::string version = std::string(system.version);
  if (first_line("/sys/kernel/realtime") == "1" || version.find("PREEMPT_RT") != std::string::npos) {
    return {"kernel", Fitness::kGood, release + ", fully preemptible", ""};
  }
  return {"kernel", Fitness::kLimited, release + ", not a real-time kernel: expect rare wake-ups late by milliseconds",
          "install linux-image-rt-amd64"};
}

RealtimeCheck check_cores() {
  const unsigned cores = std::thread::hardware_concurrency();
  const std::string isolated = first_line("/sys/devices/system/cpu/isolated");
  const std::string found =
      std::to_string(cores) + " cores" + (isolated.empty() ? ", none isolated" : ", isolated: " + isolated);
  if (cores < 4) {
    return {"cores", Fitness::kLimited, found, "give the daemon a machine with four cores or more"};
  }
  return {"cores", Fitness::kGood, found, ""};
}

RealtimeCheck check_governor() {
  const std::string governor = first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  if (governor.empty()) {
    return {"governor", Fitness::kGood, "the kernel does not scale the clock of the cores", ""};
  }
  if (governor == "performance") {
    return {"governor", Fitness::kGood, "performance", ""};
  }
  return {"governor", Fitness::kLimited, governor + ": a core that slept starts slowly",
          "run: cpupower frequency-set --governor performance"};
}

RealtimeCheck check_clock_source() {
  const std::string source = first_line("/sys/devices/system/clocksource/clocksource0/current_clocksource");
  const bool slow = source == "hpet" || source == "acpi_pm" || source == "jiffies";
  if (slow) {
    return {"clock source", Fitness::kLimited, source + ": reading the time takes microseconds",
            "boot with tsc=reliable if the processor's time stamp counter is invariant"};
  }
  return {"clock source", Fitness::kGood, source.empty() ? "unknown" : source, ""};
}

RealtimeCheck check_synchronisation() {
  timex state{};
  const int status = adjtimex(&state); // modes 0: only reads
  if (status < 0 || status == TIME_ERROR || (state.status & STA_UNSYNC) != 0) {
    return {"clock", Fitness::kLimited, "not synchronised: times of other hosts cannot be compared",
            "run chrony or ptp4l; not needed when all drivers run on this host"};
  }
  return {"clock", Fitness::kGood, "synchronised, within " + std::to_string(state.maxerror) + " us", ""};
}

RealtimeCheck check_sockets() {
  constexpr long kNeeded = 1 << 20;
  const long max_bytes = number("/proc/sys/net/core/rmem_max", 0);
  const std::string found = "receive buffers up to " + std::to_string(max_bytes / 1024) + " KiB";
  if (max_bytes > 0 && max_bytes < kNeeded) {
    return {"sockets", Fitness::kLimited, found + ": bursts of large samples may be lost",
            "set sysctl net.core.rmem_max=1048576"};
  }
  return {"sockets", Fitness::kGood, max_bytes > 0 ? found : "limit of receive buffers unknown", ""};
}

} // namespace

std::vector<RealtimeCheck> check_realtime() {
  return {check_fifo(),     check_memory_lock(),  check_throttling(),      check_kernel(), check_cores(),
          check_governor(), check_clock_source(), check_synchronisation(), check_sockets()};
}

} // namespace bregma::runtime
