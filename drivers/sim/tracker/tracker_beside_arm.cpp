#include "drivers/sim/tracker/tracker_beside_arm.hpp"

#include <chrono>
#include <filesystem>
#include <stdexcept>

#include "drivers/sim/arm/simulated_arm.hpp"

namespace bregma::sim {

namespace {

using namespace std::chrono_literals;

PatientParameters parameters_of(const TrackerPlace &place) {
  PatientParameters out;
  out.camera_direction = place.camera_direction;
  out.camera_distance_mm = place.camera_distance_mm;
  return out;
}

} // namespace

TrackerBesideArm::TrackerBesideArm(const casefile::Case &a_case, const std::string &body, const TrackerPlace &place,
                                   std::uint64_t seed)
    : patient_(a_case, parameters_of(place), seed), body_(patient_.tool(body)), clock_({}, seed),
      camera_(patient_, {}, seed) {
  if (body_ == nullptr) {
    throw std::invalid_argument("case " + a_case.id + " has no tool " + body);
  }
  T_flange_body_ = {Quaterniond::FromTwoVectors(body_->model.normal, -Vector3d::UnitZ()), place.body_mm};
}

wire::TrackerFrame TrackerBesideArm::measure(const Scene &scene) {
  if (!T_base_tracker_) {
    T_base_tracker_ = scene.T_base_image * patient_.T_tracker_image.inverse();
  }
  const auto T_tracker_base = T_base_tracker_->inverse();
  const T_TrackerImage T_tracker_image = T_tracker_base * scene.T_base_image;
  camera_.place_head(T_tracker_image);
  wire::TrackerFrame out{};
  out.frame = ++frame_;
  out.device_time_ns = clock_.stamp(static_cast<std::int64_t>(scene.time_us) * 1'000);
  const TrueTool &reference = patient_.tools[patient_.reference];
  const T_TrackerTool T_tracker_reference =
      (T_tracker_image * patient_.T_image_reference).as<frame::Tracker, frame::Tool>();
  out.tools[out.tool_count++] = camera_.measure(reference, T_tracker_reference, false);
  out.tools[out.tool_count++] = camera_.measure(*body_, T_tracker_base * scene.T_base_flange * T_flange_body_, false);
  return out;
}

void TrackerDevice::declare(base::ParameterSet &parameters) {
  parameters.string("address", &address_, "Of the scene: what bregma-sim-arm --scene-port prints, tcp://HOST:PORT")
      .string("case", &case_, "Folder of the case that is navigated: the head and the tools")
      .string("body", &body_, "The tool of the case that is fixed at the flange")
      .integer("seed", &seed_, "", 0, 1'000'000'000, "Of all errors");
}

base::Result<void> TrackerDevice::prepare(const driver::Settings & /*settings*/) {
  const auto loaded = casefile::load_case(std::filesystem::absolute(case_));
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  try {
    tracker_.emplace(*loaded, body_, TrackerPlace{}, static_cast<std::uint64_t>(seed_));
  } catch (const std::invalid_argument &error) {
    return base::failure(error.what());
  }
  return driver::check_address("address", address_);
}

driver::Outcome<void> TrackerDevice::connect(driver::Io &io) {
  lines_.reset();
  return stream_.open(address_, io);
}

driver::Outcome<driver::Progress> TrackerDevice::read(driver::Io &io) {
  const auto bytes = stream_.read(io, 100ms);
  if (!bytes) {
    return tl::unexpected(bytes.error());
  }
  const std::size_t too_long = lines_.take(*bytes, [&](std::string_view line) {
    const auto scene = parse_scene(line);
    if (!scene) {
      io.skipped(1, scene.error());
      return;
    }
    wire::TrackerFrame frame = tracker_->measure(*scene);
    frame.period_ns = SimulatedArm::kTicksPerScene * SimulatedArm::kTick_ns;
    (void)io.publish(frame);
  });
  if (too_long > 0) {
    io.skipped(too_long, "line too long");
  }
  return driver::Progress::kContinue;
}

} // namespace bregma::sim
