// Alarm conditions of the daemon's process: another daemon on its domain or state directory, and loops that overrun.
// They are watched by the main thread and read by the session's stage. Pure: the caller passes facts and time.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "server/stages/monitoring/alarm_conditions.hpp"

namespace bregma::server {

struct LoopOverruns {
  std::string loop;
  std::uint64_t overruns = 0; // since the start
};

struct ProcessFacts {
  std::string other_daemons;       // names of those heard on the domain; empty: none
  std::string refused_process;     // asked for the state directory since the last call; empty: none
  std::vector<LoopOverruns> loops; // all of them
};

class ProcessAlarms {
public:
  void update(const ProcessFacts &facts, std::int64_t now_ns);

  AlarmEvents events; // for the session

private:
  AlarmConditions alarms_{events};
  std::map<std::string, std::uint64_t> overruns_; // per loop, at the last call
};

} // namespace bregma::server
