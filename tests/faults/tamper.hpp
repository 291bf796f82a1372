// Changes of a device's samples, as a faulty driver or device makes them.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "idl/topics.hpp"
#include "tests/faults/cell.hpp"
#include "tests/faults/ledger.hpp"

namespace bregma::faults {

// The samples of one device while the fault lasts, and after it where the fault stays.
template <class Sample> class Tamper {
public:
  // tool: the navigated one, whose poses are changed. step_s: of a clock.
  Tamper(Content content, std::string tool, double step_s)
      : content_(content), tool_(std::move(tool)), step_ns_(static_cast<std::int64_t>(step_s * 1e9)) {}

  // Before the first faulty sample.
  void begin(const Sample &last_good) { before_ = last_good; }
  void change(Sample &sample);
  // Faults that stay when their time is over.
  [[nodiscard]] bool stays() const;

private:
  void change_values(Sample &sample);

  Content content_;
  std::string tool_;
  std::int64_t step_ns_;
  Sample before_{};
  std::optional<Sample> first_; // the first faulty sample, as it was sent
};

template <> void Tamper<wire::TrackerFrame>::change_values(wire::TrackerFrame &frame);
template <> void Tamper<wire::RobotState>::change_values(wire::RobotState &state);
template <> void Tamper<wire::RangeSample>::change_values(wire::RangeSample &sample);
template <> void Tamper<wire::ForceSample>::change_values(wire::ForceSample &sample);

// What a frame that was changed so is worth.
[[nodiscard]] FrameTruth truth_of(Content content, const std::string &tool, std::int64_t exposure_ns);

// Added to the numbers of another tracker's frames.
inline constexpr std::uint64_t kForeignNumbers = 1'000'000;
// A frame of another tracker with the same name: its tools are 20 mm beside.
[[nodiscard]] wire::TrackerFrame foreign_frame(const wire::TrackerFrame &frame);

} // namespace bregma::faults
