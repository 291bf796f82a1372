// The tools in somebody's hand or in their stands: where each truly is at a time. Frame: Image.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "drivers/sim/motion.hpp"
#include "drivers/sim/patient.hpp"
#include "drivers/sim/scenario.hpp"

namespace bregma::sim {

class Hands {
public:
  // Every tool begins in its stand.
  Hands(std::vector<HandPose> stands, const OperatorParameters &parameters, const Patient &patient, std::uint64_t seed);

  // The start of time; before anything else.
  void begin(std::int64_t start_ns) { start_ns_ = start_ns; }
  // From where the tool is meant to be now; the caller made the movement to begin there.
  void start(std::size_t tool, std::unique_ptr<Movement> movement, std::int64_t now_ns);
  // Without a movement: the tool is guided by somebody who says so several times a tremor period.
  void hold(std::size_t tool, const HandPose &pose);
  [[nodiscard]] bool still(std::size_t tool, std::int64_t now_ns) const;

  // What the hand means, and what the tool truly does.
  [[nodiscard]] HandPose meant(std::size_t tool, std::int64_t time_ns) const;
  [[nodiscard]] T_ImageTip true_tip(std::size_t tool, const HandPose &meant, std::int64_t time_ns) const;
  [[nodiscard]] const HandPose &stand(std::size_t tool) const { return tools_[tool].stand; }

private:
  struct Held {
    HandPose stand;
    HandPose rest; // when there is no movement
    std::unique_ptr<Movement> movement;
    std::int64_t start_ns = 0;
    Tremor tremor;
  };
  std::vector<Held> tools_;
  std::int64_t start_ns_ = 0;
};

} // namespace bregma::sim
