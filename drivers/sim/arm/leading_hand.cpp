#include "drivers/sim/arm/leading_hand.hpp"

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <optional>
#include <string_view>
#include <utility>

#include <fcntl.h>
#include <unistd.h>

#include "algorithms/geometry/angles.hpp"
#include "base/text.hpp"

namespace bregma::sim {

namespace {

// Exactly these numbers, all of them finite and below 1000.
template <std::size_t N>
std::optional<std::array<double, N>> numbers_after(std::string_view line, std::string_view word) {
  std::array<double, N> out{};
  line.remove_prefix(word.size());
  for (std::size_t i = 0; i < N; ++i) {
    const std::size_t end = line.find(' ');
    const auto value = base::parsed_number<double>(line.substr(0, end));
    if (!value || !(std::abs(*value) < 1000.0) || (end == std::string_view::npos) != (i + 1 == N)) {
      return std::nullopt;
    }
    out[i] = *value;
    line = end == std::string_view::npos ? std::string_view() : line.substr(end + 1);
  }
  return out;
}

} // namespace

base::Result<FaceBeforeArm> FaceBeforeArm::of_case(const std::filesystem::path &folder, const Vector3d &nose_mm,
                                                   double yaw_rad, std::uint64_t seed) {
  auto loaded = casefile::load_case(folder);
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  constexpr double kSkinError_mm = 0.3, kCorrelation_mm = 15.0; // of the segmented scalp
  Head head(loaded->scalp.mesh, kSkinError_mm, kCorrelation_mm, seed);
  const BaseImage T_base_image = lying_head(head, nose_mm, yaw_rad);
  const MovingHead place(T_base_image, head.centre_mm());
  return FaceBeforeArm{std::move(*loaded), std::move(head), place, T_base_image};
}

base::Result<LeadingHand> LeadingHand::open(const std::filesystem::path &fifo, FaceBeforeArm &face,
                                            const Vector3d &tip_mm, const robot::FlangePose &first) {
  // For writing as well, so that the line does not end with its first writer.
  const int opened = ::open(fifo.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (opened < 0) {
    return base::failure(fifo.string() + ": " + std::strerror(errno));
  }
  return LeadingHand(opened, face, tip_mm, first);
}

LeadingHand::LeadingHand(LeadingHand &&other) noexcept
    : face_(other.face_), tip_mm_(std::move(other.tip_mm_)), first_(std::move(other.first_)),
      fifo_(std::exchange(other.fifo_, -1)), received_(std::move(other.received_)),
      going_to_(std::move(other.going_to_)) {}

LeadingHand::~LeadingHand() {
  if (fifo_ >= 0) {
    ::close(fifo_);
  }
}

std::string LeadingHand::serve(SimulatedArm &arm, std::int64_t now_ns) {
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
  if (name.starts_with("patient ")) {
    const std::string problem = move_patient(name, now_ns);
    return problem.empty() ? "at " + name : name + ": " + problem;
  }
  const std::string problem = name.starts_with("flange ") ? lead_flange(arm, name) : lead(arm, name);
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

std::string LeadingHand::lead_flange(SimulatedArm &arm, const std::string &line) const {
  const auto v = numbers_after<6>(line, "flange ");
  if (!v) {
    return "needs six numbers";
  }
  const Vector3d turn_rad = Vector3d((*v)[3], (*v)[4], (*v)[5]) * geometry::kRadiansPerDegree;
  return arm.lead(
      {{first_.rotation() * geometry::rotation_exp(turn_rad), first_ * Vector3d((*v)[0], (*v)[1], (*v)[2])}},
      kSpeed_mm_s);
}

std::string LeadingHand::move_patient(const std::string &line, std::int64_t now_ns) {
  const auto v = numbers_after<4>(line, "patient ");
  if (!v || !((*v)[3] >= 0.0 && (*v)[3] <= 60.0)) {
    return "needs three distances and up to 60 seconds";
  }
  geometry::Vector6d to = geometry::Vector6d::Zero();
  to.tail<3>() << (*v)[0], (*v)[1], (*v)[2];
  face_->place.move(to, (*v)[3], now_ns);
  return {};
}

} // namespace bregma::sim
