#include "server/config.hpp"

#include "server/wiring.hpp"

namespace bregma::server {

base::ParameterSet declare(Config &c) {
  base::ParameterSet set("bregmad");
  set.integer("domain_id", &c.domain_id, "", 0, 230,
              "DDS domain. Processes on different domains do not see each other.");
  declare_stages(set, c.stages);
  set.flag("recorder.enabled", &c.recorder.enabled, "Record all input and output to a session file.");
  set.number("recorder.commit_ms", &c.recorder.commit_ms, "ms", 5, 100,
             "Records are committed to the session file this often; a killed daemon loses this and the last commit.");
  set.flag("recorder.truth", &c.recorder.truth, "Record the truth too when a simulator publishes it.");
  set.string("log.file", &c.log.file, "Log file in addition to the console; empty: none.");
  base::declare_log_level(set, &c.log.level, "Minimum severity of log messages.");
  set.flag("realtime.lock_memory", &c.realtime.lock_memory,
           "Lock the process in memory. Without the right to do so the daemon logs it and continues.");
  return set;
}

base::Result<void> check(Config &config) { return check_stages(config.stages); }

} // namespace bregma::server
