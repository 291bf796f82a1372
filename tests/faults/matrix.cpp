// The fault matrix. One row per cell: subject, fault, variant, what happens, what must be seen.
#include <cstdio>

#include "tests/faults/cell.hpp"

namespace bregma::faults {
namespace {

using enum Subject;
using enum Fault;

constexpr double kSteps_s[] = {-3600.0, -5.0, -0.1, 0.05, 3600.0}; // of a clock

// "+0.05 s"
std::string seconds(double value) {
  char text[32];
  (void)std::snprintf(text, sizeof text, "%+g s", value);
  return text;
}

Expectation undisturbed() { return {}; }
Expectation short_gap() { return {.max_gap_ms = 500.0}; }
// An alarm with one of these words; poses may end while the fault lasts.
Expectation alarm(std::vector<std::string> words, During from = During::kIdle) {
  return {.alarm = std::move(words), .alarm_from = from, .max_gap_ms = 0.0};
}
Expectation critical(std::vector<std::string> words, During from = During::kIdle) {
  Expectation out = alarm(std::move(words), from);
  out.critical = true;
  return out;
}
// The same, and no pose pauses.
Expectation noticed(std::vector<std::string> words) { return {.alarm = std::move(words)}; }
Expectation malformed(const char *word, During from = During::kIdle) {
  Expectation out = alarm({word}, from);
  out.malformed = true;
  out.critical = true; // no usable frame for a second: the tracker counts as lost
  return out;
}
// Well-formed, but wrong: recognised by the plausibility stage. The device or the tool is named.
Expectation implausible(std::vector<std::string> words) {
  Expectation out = critical(std::move(words), During::kRegistered);
  return out;
}

auto adder(std::vector<Cell> &out, Subject subject) {
  return [&out, subject](Fault fault, const char *variant, Cell cell) {
    cell.subject = subject;
    cell.fault = fault;
    cell.variant = variant;
    out.push_back(std::move(cell));
  };
}

void add_tracker(std::vector<Cell> &out) {
  const auto add = adder(out, kTracker);
  const std::vector<std::string> tools{"Stylus", "Probe", "Tracker"};
  add(kSilent, "", {.lasts_s = 2.0, .link = {.cut = true}, .expect = critical({"tracker_lost Tracker"})});
  add(kLate, "20 ms", {.link = {.delay_ms = 20.0}, .expect = undisturbed()});
  add(kLate, "100 ms", {.link = {.delay_ms = 100.0}, .expect = critical({"Tracker", "late"}, During::kRegistered)});
  add(kLate, "500 ms", {.link = {.delay_ms = 500.0}, .expect = critical({"Tracker", "late"}, During::kRegistered)});
  add(kLate, "ramp of 10 ms/s",
      {.lasts_s = 8.0, .link = {.ramp_ms_per_s = 10.0}, .expect = {.critical = true, .max_gap_ms = 0.0}});
  add(kReordered, "", {.link = {.reordered = 0.2}, .expect = undisturbed()});
  add(kDuplicated, "", {.link = {.copies = 2}, .expect = undisturbed()});
  add(kFrozen, "", {.content = Content::kFrozen, .expect = implausible(tools)});
  out.back().expect.reverify = true; // the reference is frozen as well
  add(kFrozen, "reference", {.content = Content::kFrozenReference, .expect = implausible({"Reference", "Tracker"})});
  out.back().expect.reverify = true;
  add(kNotFinite, "position", {.content = Content::kNotFinite, .expect = malformed("Tracker")});
  add(kNotFinite, "residual", {.content = Content::kNotFiniteRms, .expect = malformed("Tracker")});
  add(kJumping, "tool", {.content = Content::kJump, .expect = implausible(tools)});
  add(kJumping, "reference", {.content = Content::kJumpReference, .expect = implausible({"Reference", "Tracker"})});
  out.back().expect.reverify = true;
  add(kJumping, "residual", {.content = Content::kResidual, .expect = implausible(tools)});
  add(kWrongTool, "one more", {.content = Content::kStrangeTool, .expect = noticed({"Stranger"})});
  out.back().expect.alarm_from = During::kCaseLoaded; // without a case every tool is known
  add(kWrongTool, "another device", {.content = Content::kStrangeDevice, .expect = critical({"Stranger"})});
  for (const double step_s : kSteps_s) {
    add(kClockStep, seconds(step_s).c_str(),
        {.content = Content::kDeviceClock, .step_s = step_s, .expect = short_gap()});
  }
  add(kRestarted, "new numbers",
      {.lasts_s = 0.5, .content = Content::kRenumbered, .expect = {.critical = true, .max_gap_ms = 0.0}});
  add(kRestarted, "numbers go on",
      {.lasts_s = 5.0, .link = {.cut = true, .new_writer_after = true}, .expect = critical({"tracker_lost Tracker"})});
  add(kMalformed, "too many tools", {.content = Content::kTooManyParts, .expect = malformed("Tracker")});
  add(kMalformed, "no period", {.content = Content::kNoPeriod, .expect = malformed("Tracker")});
  add(kMalformed, "name without end", {.content = Content::kNoName, .expect = malformed("Tracker")});
  constexpr During kCase = During::kCaseLoaded; // without a case the markers are not known
  add(kMalformed, "two markers", {.content = Content::kTwoMarkers, .expect = malformed("Tracker", kCase)});
  add(kMalformed, "foreign markers", {.content = Content::kForeignMarkers, .expect = malformed("Tracker", kCase)});
  add(kMalformed, "mask against status",
      {.content = Content::kHiddenWithMarkers, .expect = malformed("Tracker", kCase)});
  add(kMalformed, "mirrored", {.content = Content::kMirrored, .expect = implausible(tools)});
  add(kMalformed, "transposed", {.content = Content::kTransposed, .expect = implausible(tools)});
  add(kMalformed, "in metres", {.content = Content::kMetres, .expect = implausible(tools)});
  for (auto cell = out.end() - 3; cell != out.end(); ++cell) {
    cell->expect.reverify = true; // the reference is implausible as well
  }
  add(kFlooded, "20 times the rate", {.lasts_s = 1.0, .content = Content::kFlood, .expect = alarm({"Tracker"})});
  add(kFlooded, "second writer", {.content = Content::kSecondWriter, .expect = critical({"Tracker"})});
}

void add_sensor(std::vector<Cell> &out, Subject subject, const char *device) {
  const std::string name(device);
  const auto add = adder(out, subject);
  add(kSilent, "", {.lasts_s = 2.0, .link = {.cut = true}, .expect = noticed({"device_lost " + name})});
  add(kLate, "500 ms", {.link = {.delay_ms = 500.0}, .expect = undisturbed()});
  add(kReordered, "", {.link = {.reordered = 0.2}, .expect = undisturbed()});
  add(kDuplicated, "", {.link = {.copies = 2}, .expect = undisturbed()});
  add(kFrozen, "", {.content = Content::kFrozen, .expect = undisturbed()});
  add(kNotFinite, "", {.content = Content::kNotFinite, .expect = noticed({name})});
  add(kJumping, "", {.content = Content::kJump, .expect = undisturbed()});
  add(kWrongTool, "another device", {.content = Content::kStrangeDevice, .expect = noticed({"Stranger"})});
  add(kClockStep, "-5 s", {.content = Content::kDeviceClock, .step_s = -5.0, .expect = undisturbed()});
  add(kClockStep, "+3600 s", {.content = Content::kDeviceClock, .step_s = 3600.0, .expect = undisturbed()});
  add(kRestarted, "new numbers", {.lasts_s = 0.5, .content = Content::kRenumbered, .expect = undisturbed()});
  add(kRestarted, "numbers go on",
      {.lasts_s = 5.0, .link = {.cut = true, .new_writer_after = true}, .expect = noticed({"device_lost " + name})});
  if (subject != kForce) {
    add(kMalformed, "out of range", {.content = Content::kTooManyParts, .expect = noticed({name})});
  }
  add(kMalformed, "no period", {.content = Content::kNoPeriod, .expect = noticed({name})});
  add(kFlooded, "20 times the rate", {.lasts_s = 1.0, .content = Content::kFlood, .expect = noticed({name})});
}

// A case without a tracker: the arm navigates, and its sensor scans.
void add_arm(std::vector<Cell> &out) {
  const auto add = adder(out, kArm);
  add(kSilent, "", {.lasts_s = 1.0, .link = {.cut = true}, .expect = critical({"robot_lost Robot"})});
  add(kJumping, "30 mm", {.lasts_s = 1.0, .content = Content::kJump, .expect = implausible({"implausible Pointer"})});
  add(kFrozen, "numbers go on",
      {.lasts_s = 1.0, .content = Content::kFrozen, .expect = implausible({"implausible Pointer"})});
  add(kWrongTool, "another one is mounted",
      {.lasts_s = 1.0, .content = Content::kOtherTool, .expect = implausible({"implausible RobotBase"})});
  out.back().expect.reverify = true;
  add(kRestarted, "another driver",
      {.lasts_s = 1.0, .content = Content::kOtherDriver, .expect = critical({"robot_lost Robot"})});
  out.back().expect.reverify = true;
  const auto beside = adder(out, kBesideArm);
  beside(kSilent, "the arm", {.lasts_s = 1.0, .link = {.cut = true}, .expect = critical({"robot_lost Robot"})});
  beside(kFrozen, "the arm, numbers go on",
         {.lasts_s = 1.0, .content = Content::kFrozen, .expect = implausible({"implausible Pointer"})});
  beside(kSilent, "the reference is hidden",
         {.lasts_s = 1.0,
          .content = Content::kHiddenReference,
          .expect = alarm({"reference_hidden Reference"}, During::kRegistered)});
  beside(kJumping, "the arm's base is pushed",
         {.lasts_s = 1.0, .content = Content::kPushedBase, .expect = critical({"hand_eye Tracker"})});
  beside(kJumping, "the tracker is bumped against the arm",
         {.lasts_s = 1.0, .content = Content::kBumpedTracker, .expect = critical({"hand_eye Tracker"})});
  // The poses are true, and go on: nothing would notice if they were not.
  beside(kSilent, "the body on the flange is hidden",
         {.lasts_s = 7.0, .content = Content::kHiddenFlangeBody, .expect = noticed({"hand_eye_unchecked Tracker"})});
  const auto sensor = adder(out, kScanSensor);
  sensor(kSilent, "unplugged",
         {.lasts_s = 2.0, .content = Content::kUnplugged, .expect = alarm({"device_lost Range"})});
  sensor(kRestarted, "replugged",
         {.lasts_s = 0.2, .content = Content::kReplugged, .expect = critical({"scan_interrupted Range"})});
  sensor(kWrongTool, "swapped", {.lasts_s = 2.0, .content = Content::kSwapped, .expect = alarm({"device_lost Range"})});
}

void add_client(std::vector<Cell> &out) {
  const auto add = adder(out, kClient);
  add(kSilent, "link cut", {.lasts_s = 1.5, .link = {.cut = true}, .expect = undisturbed()});
  add(kLate, "20 ms", {.link = {.delay_ms = 20.0}, .expect = undisturbed()});
  add(kLate, "500 ms", {.link = {.delay_ms = 500.0}, .expect = undisturbed()});
  add(kLate, "joins late", {.client = ClientFault::kLate, .expect = undisturbed()});
  add(kReordered, "", {.link = {.reordered = 0.2}, .expect = undisturbed()});
  add(kDuplicated, "commands and samples", {.link = {.copies = 2}, .expect = undisturbed()});
  add(kDuplicated, "another kind under one id", {.client = ClientFault::kOtherKind, .expect = undisturbed()});
  add(kFrozen, "stopped for 3 s", {.lasts_s = 3.0, .client = ClientFault::kStopped, .expect = undisturbed()});
  add(kWrongTool, "unknown names", {.client = ClientFault::kUnknownNames, .expect = undisturbed()});
  for (const double error_s : {-3600.0, -30.0, -10.0, 0.05, 30.0, 3600.0}) {
    add(kClockStep, seconds(error_s).c_str(),
        {.client = ClientFault::kClock, .step_s = error_s, .expect = undisturbed()});
  }
  add(kMalformed, "", {.client = ClientFault::kMalformed, .expect = undisturbed()});
  add(kFlooded, "20,000 commands/s",
      {.lasts_s = 1.0, .client = ClientFault::kFloods, .expect = noticed({"command_flood"})});
}

void add_daemon(std::vector<Cell> &out) {
  const Expectation may_pause{.critical = true, .max_gap_ms = 0.0};
  Expectation restarts = may_pause;
  restarts.reverify = true;
  Expectation forgets = restarts;
  forgets.idle_after = true;
  out.push_back({kDaemon, kSilent, "killed", 1.0, {}, Content::kTrue, HostFault::kKilled, {}, 0.0, restarts});
  out.push_back(
      {kDaemon, kFrozen, "stopped for 3 s", 3.0, {}, Content::kTrue, HostFault::kStopped, {}, 0.0, may_pause});
  Expectation second = noticed({"bregmad"});
  second.critical = true;
  out.push_back(
      {kDaemon, kDuplicated, "second daemon", 2.0, {}, Content::kTrue, HostFault::kSecondDaemon, {}, 0.0, second});
  Expectation disk = noticed({"disk"});
  disk.critical = true;
  out.push_back({kDisk, kSilent, "full", 2.0, {}, Content::kTrue, HostFault::kRecorderFails, {}, 0.0, disk});
  Expectation dropped = noticed({"record"});
  dropped.critical = true;
  out.push_back(
      {kDisk, kFlooded, "records dropped", 2.0, {}, Content::kTrue, HostFault::kRecordsDropped, {}, 0.0, dropped});
  Expectation unwritable = undisturbed();
  unwritable.critical = true; // only if the session changes at that time
  out.push_back({kDisk,
                 kMalformed,
                 "state not writable",
                 2.0,
                 {},
                 Content::kTrue,
                 HostFault::kStateNotWritable,
                 {},
                 0.0,
                 unwritable});
  out.push_back(
      {kDisk, kRestarted, "state damaged", 1.0, {}, Content::kTrue, HostFault::kStateDamaged, {}, 0.0, forgets});
}

void add_clocks(std::vector<Cell> &out) {
  for (const double step_s : kSteps_s) {
    const std::string step = seconds(step_s);
    Expectation noticed_step = noticed({"clock"});
    noticed_step.max_gap_ms = 500.0;
    noticed_step.critical = false;
    out.push_back({kClock,
                   kClockStep,
                   "daemon " + step,
                   1.0,
                   {},
                   Content::kTrue,
                   HostFault::kWallClock,
                   {},
                   step_s,
                   noticed_step});
    out.push_back({kClock, kClockStep, "driver " + step, 1.0, {}, Content::kDriverClock, {}, {}, step_s, short_gap()});
  }
}

void add_network(std::vector<Cell> &out) {
  const auto add = [&out](Fault fault, const char *variant, double lasts_s, LinkFault link, Expectation expect) {
    out.push_back({kNetwork, fault, variant, lasts_s, link, Content::kTrue, {}, {}, 0.0, std::move(expect)});
  };
  add(kSilent, "cut 1 s", 1.0, {.cut = true}, critical({"tracker_lost Tracker"}));
  add(kSilent, "cut 5 s", 5.0, {.cut = true, .new_writer_after = true}, critical({"tracker_lost Tracker"}));
  add(kSilent, "cut 15 s", 15.0, {.cut = true, .new_writer_after = true}, critical({"tracker_lost Tracker"}));
  add(kSilent, "loss 1 %", 2.0, {.loss = 0.01}, undisturbed());
  add(kSilent, "loss 5 %", 2.0, {.loss = 0.05}, undisturbed());
  add(kSilent, "loss 20 %", 2.0, {.loss = 0.2}, undisturbed());
  add(kLate, "20 ms", 2.0, {.delay_ms = 20.0}, undisturbed());
  add(kReordered, "", 2.0, {.reordered = 0.2}, undisturbed());
  add(kDuplicated, "", 2.0, {.copies = 2}, undisturbed());
}

} // namespace

const std::vector<Cell> &matrix() {
  static const std::vector<Cell> kMatrix = [] {
    std::vector<Cell> out{{.expect = undisturbed()}}; // what is seen without a fault
    add_tracker(out);
    add_sensor(out, kRobot, "Robot");
    add_sensor(out, kForce, "Force");
    add_sensor(out, kRange, "Range");
    add_arm(out);
    add_client(out);
    add_daemon(out);
    add_clocks(out);
    add_network(out);
    return out;
  }();
  return kMatrix;
}

} // namespace bregma::faults
