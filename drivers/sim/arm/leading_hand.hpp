// What lies before the simulated arm, and a person who leads the arm by its hand, so that its tip touches the skin.
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
  BaseImage T_base_image;

  [[nodiscard]] static base::Result<FaceBeforeArm> of_case(const std::filesystem::path &folder, const Vector3d &nose_mm,
                                                           double yaw_rad, std::uint64_t seed);
};

// Reads a FIFO: the name of a fiducial or landmark per line leads the tip there, from above; "up" leads away; "where"
// leads nowhere.
class LeadingHand {
public:
  static constexpr double kUp_mm = 40.0, kSpeed_mm_s = 60.0;

  // face outlives this. tip_mm: in the flange.
  [[nodiscard]] static base::Result<LeadingHand> open(const std::filesystem::path &fifo, const FaceBeforeArm &face,
                                                      const Vector3d &tip_mm);
  LeadingHand(LeadingHand &&other) noexcept;
  LeadingHand &operator=(LeadingHand &&) = delete;
  ~LeadingHand();

  // "at NAME" when the arm has come there, or why it is not led; "tip R A S", in mm, where the tip truly is in Image;
  // else empty.
  [[nodiscard]] std::string serve(SimulatedArm &arm);

private:
  LeadingHand(int fifo, const FaceBeforeArm &face, const Vector3d &tip_mm)
      : face_(&face), tip_mm_(tip_mm), fifo_(fifo) {}
  [[nodiscard]] std::string lead(SimulatedArm &arm, const std::string &name) const;

  const FaceBeforeArm *face_;
  Vector3d tip_mm_;
  int fifo_;
  std::string received_, going_to_;
};

} // namespace bregma::sim
