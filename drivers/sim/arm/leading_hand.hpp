// What lies before the simulated arm, and a person who leads the arm by its hand, so that its tip touches the skin, and
// moves the patient.
//
// Not for several threads at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "drivers/sim/arm/carried_sensor.hpp"
#include "drivers/sim/arm/simulated_arm.hpp"

namespace bregma::sim {

// The true head of a case, on its back.
struct FaceBeforeArm {
  casefile::Case a_case;
  Head head;
  MovingHead place;
  BaseImage T_base_image; // now

  void advance(std::int64_t now_ns) { T_base_image = place.at(now_ns); }

  [[nodiscard]] static base::Result<FaceBeforeArm> of_case(const std::filesystem::path &folder, const Vector3d &nose_mm,
                                                           double yaw_rad, std::uint64_t seed);
};

// Reads a FIFO, one line after another. The name of a fiducial or landmark leads the tip there, from above; "up" leads
// away; "flange X Y Z RX RY RZ" leads the flange to where it was at first, displaced by this along its axes and turned
// about them (mm, degrees); "where" leads nowhere; "patient X Y Z SECONDS" moves the head to this displacement from its
// rest, along the base's axes (mm).
class LeadingHand {
public:
  static constexpr double kUp_mm = 40.0, kSpeed_mm_s = 60.0;

  // face outlives this. tip_mm: in the flange. first: where the flange is at first.
  [[nodiscard]] static base::Result<LeadingHand> open(const std::filesystem::path &fifo, FaceBeforeArm &face,
                                                      const Vector3d &tip_mm, const robot::FlangePose &first);
  LeadingHand(LeadingHand &&other) noexcept;
  LeadingHand &operator=(LeadingHand &&) = delete;
  ~LeadingHand();

  // "at LINE" when the arm has come there, and as soon as the patient begins to move; or why the line does nothing;
  // "tip R A S", in mm, where the tip truly is in Image; else empty.
  [[nodiscard]] std::string serve(SimulatedArm &arm, std::int64_t now_ns);

private:
  LeadingHand(int fifo, FaceBeforeArm &face, const Vector3d &tip_mm, const robot::FlangePose &first)
      : face_(&face), tip_mm_(tip_mm), first_(first), fifo_(fifo) {}
  [[nodiscard]] std::string lead(SimulatedArm &arm, const std::string &name) const;
  [[nodiscard]] std::string lead_flange(SimulatedArm &arm, const std::string &line) const;
  [[nodiscard]] std::string move_patient(const std::string &line, std::int64_t now_ns);

  FaceBeforeArm *face_;
  Vector3d tip_mm_;
  robot::FlangePose first_;
  int fifo_;
  std::string received_, going_to_;
};

} // namespace bregma::sim
