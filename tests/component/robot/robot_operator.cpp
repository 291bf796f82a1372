#include "tests/component/robot/robot_operator.hpp"

#include <stdexcept>
#include <string>

#include "idl/commands.hpp"

namespace bregma::test {

namespace {

constexpr double kTouchSpeed_mm_s = 80.0;
constexpr double kBefore_mm = 30.0;

void require_done(const wire::CommandReply &reply) {
  if (reply.result != bregma_wire_COMMAND_DONE) {
    throw std::runtime_error(wire::command_name(reply.kind) + ": " + reply.text);
  }
}

} // namespace

void RobotOperator::done(wire::CommandKind kind, std::initializer_list<std::string_view> values) {
  require_done(room_.command(kind, values));
}

void RobotOperator::move(const std::vector<RobotRoom::Flange> &path, double speed_mm_s) {
  if (!room_.move(path, speed_mm_s)) {
    throw std::runtime_error("the arm does not get there");
  }
}

void RobotOperator::begin() {
  if (!room_.run(3.0, [&] { return room_.device("Range") != nullptr && room_.device("Range")->taken > 0; })) {
    throw std::runtime_error("no reading: " + room_.range_error);
  }
  room_.run(0.5);
  done(bregma_wire_COMMAND_LOAD_CASE, {case_.folder.string()});
  done(bregma_wire_COMMAND_START_REGISTRATION);
}

void RobotOperator::scan(double spacing_mm, double speed_mm_s) {
  const auto path = room_.raster(48.0, 56.0, spacing_mm);
  move({path.front()}, kTouchSpeed_mm_s);
  done(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "0", "3"});
  move(path, speed_mm_s);
  done(bregma_wire_COMMAND_STOP_SURFACE_SCAN, {"Robot"});
  room_.run(1.0);
}

wire::CommandReply RobotOperator::touch(wire::CommandKind kind, const casefile::NamedPoint &point) {
  move({room_.touching(point.position_mm, kBefore_mm), room_.touching(point.position_mm)}, kTouchSpeed_mm_s);
  const wire::CommandReply reply = room_.command(kind, {"Pointer", point.name});
  move({room_.touching(point.position_mm, kBefore_mm)}, kTouchSpeed_mm_s);
  return reply;
}

void RobotOperator::touch_fiducials() {
  for (const casefile::NamedPoint &fiducial : case_.fiducials) {
    require_done(touch(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, fiducial));
  }
}

void RobotOperator::verify() {
  for (const casefile::NamedPoint &landmark : case_.landmarks) {
    require_done(touch(bregma_wire_COMMAND_CHECK_TOUCH, landmark));
  }
  done(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
}

void RobotOperator::register_by_touches() {
  touch_fiducials();
  done(bregma_wire_COMMAND_ACCEPT_REGISTRATION);
}

void RobotOperator::navigate() {
  begin();
  register_by_touches();
  verify();
  done(bregma_wire_COMMAND_START_NAVIGATION, {"Pointer", ""});
  if (!room_.run(1.0, [&] { return live(); })) {
    throw std::runtime_error("no live pose");
  }
}

} // namespace bregma::test
