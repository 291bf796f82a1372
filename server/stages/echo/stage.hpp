// Stage echo: passes on its input; the example of docs/new-stage.md. It is off without a rate. Its output compared with
// its input shows the delay of one hop between two stages.
#pragma once

#include "base/parameters.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct EchoParameters {
  double rate_hz = 0.0; // 0: off
};
inline void declare(base::ParameterSet &set, EchoParameters &p) {
  set.number("echo.rate_hz", &p.rate_hz, "Hz", 0, 1000, "Rate of the example stage echo (docs/new-stage.md); 0: off.");
}

class EchoStage final : public Stage {
public:
  static constexpr const char *kName = "echo";
  using Parameters = EchoParameters;

  EchoStage(const EchoParameters &parameters, const StageContext & /*context*/)
      : Stage(kName, {.thread = ThreadClass::kFifo, .rate_hz = parameters.rate_hz}) {}
  void connect(const runtime::LatestValue<ProbeView> &source) { probe_.connect(source); }

  void step(const Moment & /*now*/) noexcept override {
    if (probe_.refresh()) {
      probe.store(probe_.value());
    }
  }

  runtime::LatestValue<ProbeView> probe; // the input, one step later

private:
  runtime::LatestInput<ProbeView> probe_;
};

} // namespace bregma::server
