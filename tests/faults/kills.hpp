// SIGKILL of the daemon while it records, with real processes and every core busy.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

namespace bregma::faults {

struct Kill {
  std::string failure;       // empty: the daemon came back
  double registered_s = 0.0; // from its start to the restored registration
  double late_ms = 0.0;      // from the first published state to the first recorded one
  double lost_ms = 0.0;      // from the last recorded state to the last published one, before the kill
};

class Kills {
public:
  // Brings a session to Registered, starts the devices, and busies every core. Throws std::runtime_error, dds::Error.
  explicit Kills(std::uint64_t seed);
  ~Kills();
  Kills(const Kills &) = delete;
  Kills &operator=(const Kills &) = delete;

  // Starts the daemon, kills it at a random time after its registration is back, and reads what it has recorded.
  [[nodiscard]] Kill next();

private:
  struct State;
  std::unique_ptr<State> state_;
};

} // namespace bregma::faults
