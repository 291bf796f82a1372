#include "drivers/sim/arm/leading_hand.hpp"

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <unistd.h>

namespace bregma::sim {

base::Result<FaceBeforeArm> FaceBeforeArm::of_case(const std::filesystem::path &folder, const Vector3d &nose_mm,
                                                   double yaw_rad, std::uint64_t seed) {
  auto loaded = casefile::load_case(folder);
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  constexpr double kSkinError_mm = 0.3, kCorrelation_mm = 15.0; // of the segmented scalp
  Head head(loaded->scalp.mesh, kSkinError_mm, kCorrelation_mm, seed);
  const BaseImage T_base_image = lying_head(head, nose_mm, yaw_rad);
  return FaceBeforeArm{std::move(*loaded), std::move(head), T_base_image};
}

base::Result<LeadingHand> LeadingHand::open(const std::filesystem::path &fifo, const FaceBeforeArm &face,
                                            const Vector3d &tip_mm) {
  // For writing as well, so that the line does not end with its first writer.
  const int opened = ::open(fifo.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (opened < 0) {
    return base::failure(fifo.string() + ": " + std::strerror(errno));
  }
  return LeadingHand(opened, face, tip_mm);
}

LeadingHand::LeadingHand(LeadingHand &&other) noexcept
    : face_(other.face_), tip_mm_(std::move(other.tip_mm_)), fifo_(std::exchange(other.fifo_, -1)),
      received_(std::move(other.received_)), going_to_(std::move(other.going_to_)) {}

LeadingHand::~LeadingHand() {
  if (fifo_ >= 0) {
    ::close(fifo_);
  }
}

std::string LeadingHand::serve(SimulatedArm &arm) {
  std::array<char, 256> bytes{};
  if (const auto size = ::read(fifo_, bytes.data(), bytes.size()); size > 0) {
    received_.append(bytes.data(), static_cast<std::size_t>(size));
  }
  if (arm.led()) {
    return {};
  }
  if (!going_to_.empty()) {
    return "at " + std::exchange(going_to_, {});
  }
  const auto end = received_.find('\n');
  if (end == std::string::npos) {
    return {};
  }
  std::string name = received_.substr(0, end);
  received_.erase(0, end + 1);
  if (name == "where") {
    const Vector3d tip = face_->T_base_image.inverse() * (arm.true_flange() * tip_mm_);
    std::array<char, 100> text{};
    std::snprintf(text.data(), text.size(), "tip %.3f %.3f %.3f", tip.x(), tip.y(), tip.z());
    return text.data();
  }
  const std::string problem = lead(arm, name);
  if (!problem.empty()) {
    return name + ": " + problem;
  }
  going_to_ = std::move(name);
  return {};
}

std::string LeadingHand::lead(SimulatedArm &arm, const std::string &name) const {
  const robot::FlangePose here = arm.stated_flange();
  const Vector3d up_mm = -kUp_mm * (here.rotation() * Vector3d::UnitZ());
  const auto at = [&](const Vector3d &flange_mm) { return robot::FlangePose(here.rotation(), flange_mm); };
  const robot::FlangePose away = at(here.translation() + up_mm);
  if (name == "up") {
    return arm.lead({away}, kSpeed_mm_s);
  }
  for (const auto *points : {&face_->a_case.fiducials, &face_->a_case.landmarks}) {
    for (const casefile::NamedPoint &point : *points) {
      if (point.name == name) {
        const Vector3d touching_mm =
            face_->T_base_image * face_->head.skin(point.position_mm).point_mm - here.rotation() * tip_mm_;
        return arm.lead({away, at(touching_mm + up_mm), at(touching_mm)}, kSpeed_mm_s);
      }
    }
  }
  return "is no fiducial or landmark of the case";
}

} // namespace bregma::sim
