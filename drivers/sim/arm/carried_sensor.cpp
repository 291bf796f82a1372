#include "drivers/sim/arm/carried_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bregma::sim {

BeamTarget beam_on_head(const Head &head, const BaseImage &T_base_image, const robot::FlangePose &flange,
                        const FlangeBeam &beam) {
  const auto T_image_flange = T_base_image.inverse() * flange;
  const Vector3d from = T_image_flange * beam.origin_mm;
  const Vector3d along = T_image_flange.rotation() * beam.direction;
  const auto hit = head.first_hit(from, along);
  if (!hit) {
    return {2000.0, 0.0, std::nan("")}; // the sensor sees nothing there
  }
  const Vector3d normal = head.closest(*hit).normal;
  const double cosine = std::clamp(-normal.dot(along), 0.1, 1.0);
  const Vector3d in_flange = T_image_flange.rotation().conjugate() * normal;
  return {(*hit - from).norm() - head.skin_error_mm(*hit) / cosine, std::acos(cosine), std::nan(""),
          std::atan2(in_flange.y(), in_flange.x())};
}

BaseImage lying_head(const Head &head, const Vector3d &nose_mm, double yaw_rad) {
  Matrix3d axes; // of the image (RAS) in the base: anterior is up
  axes.col(2) = Vector3d(std::cos(yaw_rad), std::sin(yaw_rad), 0.0);
  axes.col(1) = Vector3d::UnitZ();
  axes.col(0) = axes.col(1).cross(axes.col(2));
  const Eigen::Quaterniond R(axes);
  return {R, nose_mm - R * head.nose_mm()};
}

struct CarriedSensor::State {
  State(Head a_head, const FlangeBeam &a_beam, const range::Identity &identity, std::uint64_t seed)
      : head(std::move(a_head)), beam(a_beam),
        analogue(
            {}, [this](std::int64_t) { return beam_on_head(head, T_base_image, flange, beam); }, seed),
        line(
            identity, {},
            [this](std::uint64_t time_us) {
              return analogue.read_volts(static_cast<std::int64_t>(time_us) * 1'000, moving);
            },
            seed) {}

  Head head;
  BaseImage T_base_image;
  FlangeBeam beam;
  robot::FlangePose flange;
  bool moving = false;
  SharpSensor analogue;
  SimulatedRangeLine line;
};

CarriedSensor::CarriedSensor(PseudoTerminal terminal, std::unique_ptr<State> state)
    : terminal_(std::move(terminal)), state_(std::move(state)) {
  terminal_.write(state_->line.start());
}
CarriedSensor::~CarriedSensor() = default;
CarriedSensor::CarriedSensor(CarriedSensor &&) noexcept = default;
CarriedSensor &CarriedSensor::operator=(CarriedSensor &&) noexcept = default;

base::Result<CarriedSensor> CarriedSensor::open(Head head, const FlangeBeam &beam, const range::Identity &identity,
                                                const std::string &link, std::uint64_t seed) {
  auto terminal = link.empty() ? PseudoTerminal::open() : PseudoTerminal::open(link);
  if (!terminal) {
    return tl::unexpected(terminal.error());
  }
  return CarriedSensor(std::move(*terminal), std::make_unique<State>(std::move(head), beam, identity, seed));
}

void CarriedSensor::serve(const robot::FlangePose &flange, const BaseImage &T_base_image, bool moving,
                          std::uint64_t now_us) {
  state_->flange = flange;
  state_->T_base_image = T_base_image;
  state_->moving = moving;
  terminal_.write(state_->line.receive(terminal_.read(std::chrono::milliseconds(0))));
  terminal_.write(state_->line.advance(now_us));
}

} // namespace bregma::sim
