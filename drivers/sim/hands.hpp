// The tools in the operator's hand or in their stands: their true poses at a time. Frame: Image.
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
  // Every tool starts in its stand.
  Hands(std::vector<HandPose> stands, const OperatorParameters &parameters, const Patient &patient, std::uint64_t seed);

  // Start of time. Call it first.
  void begin(std::int64_t start_ns) { start_ns_ = start_ns; }
  // Precondition: the movement begins at the tool's current intended pose.
  void start(std::size_t tool, std::unique_ptr<Movement> movement, std::int64_t now_ns);
  // Without a movement: the caller sets the pose several times per tremor period.
  void hold(std::size_t tool, const HandPose &pose);
  [[nodiscard]] bool still(std::size_t tool, std::int64_t now_ns) const;

  // The intended pose, and the true pose of the tool.
  [[nodiscard]] HandPose meant(std::size_t tool, std::int64_t time_ns) const;
  [[nodiscard]] T_ImageTip true_tip(std::size_t tool, const HandPose &meant, std::int64_t time_ns) const;
  [[nodiscard]] const HandPose &stand(std::size_t tool) const { return tools_[tool].stand; }

private:
  struct Held {
    HandPose stand;
    HandPose rest; // pose without a movement
    std::unique_ptr<Movement> movement;
    std::int64_t start_ns = 0;
    Tremor tremor;
  };
  std::vector<Held> tools_;
  std::int64_t start_ns_ = 0;
};

} // namespace bregma::sim
