// All stages of the daemon and their connections (wiring.cpp). bregmad runs them on threads (server/loops.hpp). Tests
// and benchmarks run the same stages in virtual time (tests/support/virtual_loops.hpp).
#pragma once

#include <memory>
#include <vector>

#include "base/parameters.hpp"
#include "base/result.hpp"
#include "server/session/session.hpp"
#include "server/stages/host.hpp"
#include "server/stages/parameters.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/stage.hpp"

namespace bregma::server {

// Declares the parameters of all stages. parameters must outlive the set.
void declare_stages(base::ParameterSet &set, StageParameters &parameters);
// Checks beyond ranges: device names. Errors name key and value.
[[nodiscard]] base::Result<void> check_stages(StageParameters &parameters);

class Wiring {
public:
  // topics and host must outlive the wiring. Throws std::invalid_argument for parameters that check_stages() refuses
  // and for more stages than SystemHealth can contain, and dds::Error.
  Wiring(StageParameters &parameters, Topics &topics, Host &host);
  ~Wiring();
  Wiring(const Wiring &) = delete;
  Wiring &operator=(const Wiring &) = delete;

  // The stages with a rate, in the order of their steps if several are due at once.
  [[nodiscard]] const std::vector<Stage *> &stages() const { return stages_; }
  // nullptr if there is no stage of that name.
  [[nodiscard]] Stage *find(std::string_view name) const;
  // For tests: data of the session's stage. Not to be called while it runs on a thread.
  [[nodiscard]] const Session &session() const;

private:
  struct Table;
  std::unique_ptr<Table> table_;
  std::vector<Stage *> stages_;
};

} // namespace bregma::server
