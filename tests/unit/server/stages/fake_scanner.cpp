#include "tests/unit/server/stages/fake_scanner.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>

#include <gtest/gtest.h>

#include "algorithms/geometry/rigid3.hpp"
#include "casefile/coil_frames.hpp"
#include "casefile/markups.hpp"
#include "drivers/sim/random.hpp"
#include "idl/commands.hpp"

namespace bregma::server::testing {

namespace {

constexpr int kPixels = 128, kSlices = 60;
constexpr double kPixel_mm = 1.5;
constexpr int kBars = 5;
constexpr double kCell_mm = 15.0, kHalfBar_mm = 1.0;
constexpr int kPhantomPixels = 92; // of 1 mm
constexpr std::uint32_t kSlicesPerTick = 20;

double in_bars(const Eigen::Vector3d &p) {
  constexpr double kEnd = 0.5 * (kBars - 1) * kCell_mm;
  int near = 0;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(p[axis]) > kEnd + kHalfBar_mm) {
      return 0.0;
    }
    near += std::abs(p[axis] + kEnd - kCell_mm * std::round((p[axis] + kEnd) / kCell_mm)) < kHalfBar_mm ? 1 : 0;
  }
  return near >= 2 ? 1.0 : 0.0;
}

std::uint16_t pixel(double value) { return static_cast<std::uint16_t>(std::clamp(std::lround(value), 0L, 65535L)); }

} // namespace

mri::CoilFrame test_frame() {
  mri::CoilFrame out;
  out.name = "test";
  out.coils = {{"t1", "top", {-38, -34, 22}},  {"t2", "top", {36, -30, 18}},     {"t3", "top", {30, 34, 27}},
               {"t4", "top", {-26, 30, 33}},   {"b1", "bottom", {-35, 14, -22}}, {"b2", "bottom", {6, -38, -28}},
               {"b3", "bottom", {34, 8, -32}}, {"b4", "bottom", {-8, 36, -17}},  {"v1", "tree", {0, 4, 9}},
               {"v2", "tree", {16, -14, -2}},  {"v3", "tree", {-18, -8, -7}}};
  return out;
}

geometry::Points3 phantom_points() {
  geometry::Points3 out(3, kBars * kBars * kBars);
  Eigen::Index column = 0;
  for (int i = 0; i < kBars; ++i) {
    for (int j = 0; j < kBars; ++j) {
      for (int k = 0; k < kBars; ++k) {
        out.col(column++) = kCell_mm * (Eigen::Vector3d(k, j, i) - Eigen::Vector3d::Constant(0.5 * (kBars - 1)));
      }
    }
  }
  return out;
}

Eigen::Vector3d test_distortion(const Eigen::Vector3d &p) {
  constexpr double kPerMm = 1.0 / 1200.0;
  const Eigen::Vector3d harmonics(p.x() * p.x() - p.y() * p.y(), 2.0 * p.y() * p.z(),
                                  1.4 * (p.x() * p.x() - p.z() * p.z())); // of degree 2; slices need later ones
  return kPerMm * harmonics;
}

FakeScanner::FakeScanner(test::MemoryTopics &topics)
    : T_device_base(geometry::rotation_exp(Eigen::Vector3d(0.05, -0.1, 0.2)), Eigen::Vector3d(3, -2, 1)),
      topics_(topics) {
  topics.observe<wire::Command>([this](const wire::Command &command) { commands_.push_back(command); });
}

void FakeScanner::reply(const wire::Command &command, wire::CommandResult result, const std::string &text) {
  if (answers) {
    topics_.put(wire::reply_to(command, result, text));
  }
}

void FakeScanner::take(const wire::Command &command) {
  ASSERT_EQ(wire::malformed(command), "");
  if (command.kind == bregma_wire_COMMAND_SET_COILS) {
    const std::string pattern = wire::text(command.body._u.coils.pattern);
    if (pattern == refuse_coils) {
      return reply(command, bregma_wire_COMMAND_REFUSED, "t2 has no current");
    }
    patterns.push_back(pattern);
    pattern_ = pattern;
    return reply(command, bregma_wire_COMMAND_DONE, pattern);
  }
  Series series;
  const std::string protocol = wire::text(command.body._u.series.protocol);
  protocols.push_back(protocol);
  series.command = command;
  std::uint32_t slices = kSlices;
  const bool phantom = protocol.starts_with("phantom"), reversed = protocol.ends_with("-reversed");
  if (phantom) {
    slices = command.body._u.series.slices > 0 ? command.body._u.series.slices : kPhantomPixels;
    series.pixels = phantom_stack(slices, reversed);
  } else {
    slices = protocol == "scout" ? 3 : kSlices;
    series.pixels = frame_stack(pattern_, reversed);
  }
  wire::ImageSlice &header = series.header;
  (void)wire::set_name(header.protocol, protocol);
  header.series = ++number_;
  header.count = slices;
  header.columns = header.rows = phantom ? kPhantomPixels : kPixels;
  header.spacing_mm[0] = header.spacing_mm[1] = header.thickness_mm = phantom ? 1.0 : kPixel_mm;
  header.coil_state = pattern_ == "background" ? bregma_wire_COILS_OFF : bregma_wire_COILS_POSITIVE;
  header.read_out = reversed ? bregma_wire_DIRECTION_ROW_NEGATIVE : bregma_wire_DIRECTION_ROW_POSITIVE;
  series_.push_back(std::move(series));
}

void FakeScanner::send_live(const std::string &protocol, std::uint32_t count, std::int64_t now_ns) {
  now_ns_ = now_ns;
  Series series;
  series.pixels = frame_stack("background");
  (void)wire::set_name(series.header.protocol, protocol);
  series.header.series = ++number_;
  series.header.count = count;
  series.header.columns = series.header.rows = kPixels;
  series.header.spacing_mm[0] = series.header.spacing_mm[1] = series.header.thickness_mm = kPixel_mm;
  series.header.coil_state = bregma_wire_COILS_OFF;
  series.header.read_out = bregma_wire_DIRECTION_ROW_POSITIVE;
  series_.push_back(std::move(series));
}

void FakeScanner::health(std::int64_t started_ns, std::uint64_t connections, wire::DriverState state,
                         const char *device) {
  wire::DriverHealth &out = health_[device];
  (void)wire::set_name(out.device, device);
  out.started_time_ns = started_ns;
  out.connections = connections;
  out.state = state;
}

void FakeScanner::restart() {
  commands_.clear();
  series_.clear();
  number_ = 0;
  frame_ = 0;
  ++writer_;
}

void FakeScanner::advance(std::int64_t now_ns) {
  now_ns_ = now_ns;
  for (const auto &[device, health] : health_) {
    if (answers) {
      topics_.put(health);
    }
  }
  for (const wire::Command &command : std::exchange(commands_, {})) {
    take(command);
  }
  kept_.clear();
  if (series_.empty()) {
    return;
  }
  Series &series = series_.front();
  kept_.push_back(series.pixels);
  wire::ImageSlice slice = series.header;
  const std::size_t size = static_cast<std::size_t>(slice.columns) * slice.rows;
  const double extent = slice.spacing_mm[0] * 0.5;
  for (std::uint32_t n = 0; n < kSlicesPerTick && series.sent < slice.count; ++n, ++series.sent) {
    wire::ImageSlice one = slice;
    (void)wire::set_name(one.device, "Scanner");
    one.frame = ++frame_;
    one.device_time_ns = one.sent_time_ns = now_ns;
    one.index = series.sent + 1;
    one.T_scanner_slice = {{1, 0, 0, 0},
                           {-extent * (slice.columns - 1.0), -extent * (slice.rows - 1.0),
                            one.thickness_mm * (series.sent - 0.5 * (slice.count - 1.0))}};
    one.pixels._buffer = const_cast<std::uint16_t *>(series.pixels->data() + series.sent * size);
    one.pixels._length = one.pixels._maximum = static_cast<std::uint32_t>(size);
    one.bandwidth_Hz_per_pixel = b0_Hz ? kBandwidth_Hz : 0.0;
    one.phase_encoding = bregma_wire_DIRECTION_COLUMN_POSITIVE;
    one.patient_position = bregma_wire_POSITION_HFS;
    one.correction = bregma_wire_CORRECTION_NONE;
    one.table_stated = true;
    one.table_mm = table_mm;
    change(one);
    topics_.put(one, writer_);
  }
  if (series.sent == slice.count) {
    if (series.command) {
      reply(*series.command, bregma_wire_COMMAND_DONE, "sent");
    }
    series_.erase(series_.begin());
  }
}

Eigen::Vector3d FakeScanner::displacement(const Eigen::Vector3d &p, double pixel_mm, bool reversed) const {
  Eigen::Vector3d out = distorts ? test_distortion(p) : Eigen::Vector3d(Eigen::Vector3d::Zero());
  out.x() += b0_Hz ? (reversed ? -1.0 : 1.0) * b0_Hz(p) * pixel_mm / kBandwidth_Hz : 0.0;
  return out;
}

std::shared_ptr<const FakeScanner::Pixels> FakeScanner::frame_stack(const std::string &pattern, bool reversed) {
  static std::map<std::string, std::shared_ptr<const Pixels>> drawn; // drawing takes most of the time of a test
  const auto cable = cables.find(pattern);
  const mri::CoilFrame frame = test_frame();
  const std::uint64_t mask = *casefile::coils_of(frame, cable != cables.end() ? cable->second : pattern);
  std::vector<Eigen::Vector3d> balls;
  std::string key = std::to_string(distorts) + std::to_string(saturation);
  for (std::size_t i = 0; i < frame.coils.size(); ++i) {
    if ((mask >> i & 1U) != 0 && !dark.contains(static_cast<int>(i))) {
      const Eigen::Vector3d at = T_device_base * frame.coils[i].position_mm + frame_moved_mm;
      balls.emplace_back(at + displacement(at, kPixel_mm, reversed));
      key +=
          " " + std::to_string(balls.back().x()) + std::to_string(balls.back().y()) + std::to_string(balls.back().z());
    }
  }
  std::shared_ptr<const Pixels> &kept = drawn[key];
  if (kept) {
    return kept;
  }
  auto out = std::make_shared<Pixels>();
  sim::Random random(balls.size(), "fake scanner");
  for (int k = 0; k < kSlices; ++k) {
    for (int j = 0; j < kPixels; ++j) {
      for (int i = 0; i < kPixels; ++i) {
        const Eigen::Vector3d at =
            kPixel_mm * (Eigen::Vector3d(i, j, k) - 0.5 * Eigen::Vector3d(kPixels - 1, kPixels - 1, kSlices - 1));
        double signal = std::max(std::abs(at.x()), std::abs(at.y())) < 80.0 ? 1000.0 : 0.0;
        for (const Eigen::Vector3d &ball : balls) {
          signal *= std::clamp(((at - ball).norm() - 6.0) / kPixel_mm + 0.5, 0.0, 1.0);
        }
        const double value = std::abs(signal + random.normal(25.0));
        out->push_back(pixel(balls.empty() ? value : std::min(value, saturation)));
      }
    }
  }
  kept = out;
  return kept;
}

std::shared_ptr<const FakeScanner::Pixels> FakeScanner::phantom_stack(std::uint32_t slices, bool reversed) const {
  const mri::Rigid3<mri::frame::Base, mri::frame::Device> T_phantom_device =
      mri::Rigid3<mri::frame::Device, mri::frame::Base>(geometry::rotation_exp(Eigen::Vector3d(0.03, -0.04, 0.05)),
                                                        Eigen::Vector3d(1.5, -1.0, 0.7) + phantom_moved_mm)
          .inverse();
  auto out = std::make_shared<Pixels>();
  sim::Random random(5, "fake phantom");
  for (std::uint32_t k = 0; k < slices; ++k) {
    for (int j = 0; j < kPhantomPixels; ++j) {
      for (int i = 0; i < kPhantomPixels; ++i) {
        const Eigen::Vector3d shown(i - 0.5 * (kPhantomPixels - 1), j - 0.5 * (kPhantomPixels - 1),
                                    k - 0.5 * (slices - 1.0));
        Eigen::Vector3d p = shown;
        for (int step = 0; step < 4 && (distorts || b0_Hz); ++step) {
          p = shown - displacement(p, 1.0, reversed);
        }
        double water = 0.0;
        for (int corner = 0; corner < 8; ++corner) {
          const Eigen::Vector3d offset(corner & 1, (corner >> 1) & 1, corner >> 2);
          water +=
              1.0 - in_bars(T_phantom_device * Eigen::Vector3d(p + 0.5 * offset - Eigen::Vector3d::Constant(0.25)));
        }
        out->push_back(pixel(std::abs(125.0 * water + random.normal(20.0))));
      }
    }
  }
  return out;
}

ScannerBench::ScannerBench(bool with_phantom, bool opposed_read_outs) {
  topics.observe<wire::ScannerRegistration>([this](const wire::ScannerRegistration &sample) { state = sample; });
  topics.observe<wire::CorrectedSlice>([this](const wire::CorrectedSlice &sample) {
    corrected_pixels.assign(sample.slice.pixels._buffer, sample.slice.pixels._buffer + sample.slice.pixels._length);
    corrected.push_back(sample);
    corrected.back().slice.pixels = {};
  });
  ScannerParameters parameters;
  parameters.frame = (folder.path() / "frame.toml").string();
  std::ofstream(parameters.frame) << casefile::coil_frame_text(test_frame());
  parameters.top = "top";
  parameters.bottom = "bottom";
  parameters.verify_protocol = "tree";
  parameters.opposed_read_outs = opposed_read_outs;
  if (with_phantom) {
    parameters.phantom = (folder.path() / "ct.mrk.json").string();
    parameters.field = (folder.path() / "field.nrrd").string();
    // Patient (Device of a patient on the back, head first, turned about x) to Image: as the phantom lies in both.
    const auto T_image_device = mri::T_image_patient() * mri::T_device_patient(mri::PatientPosition::kHfs).inverse();
    const geometry::Points3 points = phantom_points();
    std::vector<casefile::NamedPoint> named;
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      named.push_back({std::to_string(i + 1), T_image_device.rotation() * Eigen::Vector3d(points.col(i))});
    }
    EXPECT_TRUE(casefile::write_points(parameters.phantom, "grid", named));
  }
  stage = std::make_unique<ScannerStage>(parameters, StageContext{topics.link(ScannerStage::kName), host});
  stage->connect(inbox, tools);
}

void ScannerBench::step() {
  let_pass(kTick_ns);
  scanner.advance(now.utc_ns);
  stage->step(now);
  topics.deliver();
  AlarmCondition condition;
  while (stage->conditions.try_pop(condition)) {
    if (condition.active) {
      alarms.insert(wire::text(condition.kind));
    } else {
      alarms.erase(wire::text(condition.kind));
    }
  }
}

StageAnswer ScannerBench::command(wire::CommandKind kind, std::initializer_list<std::string_view> values) {
  wire::Command out{};
  EXPECT_EQ(wire::fill_command(out, kind, values), "");
  (void)wire::set_name(out.client, "test");
  inbox.send(out);
  step();
  StageAnswer answer{};
  EXPECT_TRUE(stage->answers.try_pop(answer));
  return answer;
}

bool ScannerBench::settle() {
  for (int i = 0; i < 2400; ++i) {
    step();
    if (state.activity == bregma_wire_SCANNER_WAITS || state.activity == bregma_wire_SCANNER_FAILED) {
      step(); // orders to switch off
      return true;
    }
  }
  return false;
}

const wire::ScannerRegistration &ScannerBench::procedure() {
  EXPECT_EQ(command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {"Scanner"}).result, bregma_wire_COMMAND_DONE);
  EXPECT_TRUE(settle());
  if (state.step == bregma_wire_SCANNER_STEP_SWAP && state.activity == bregma_wire_SCANNER_WAITS) {
    EXPECT_EQ(confirm("swap").result, bregma_wire_COMMAND_DONE);
    EXPECT_TRUE(settle());
  }
  return state;
}

double ScannerBench::target_error_mm(const wire::Pose &pose) const {
  const auto T_base_device = wire::from_wire<mri::frame::Base, mri::frame::Device>(pose);
  return (T_base_device * scanner.T_device_base.translation()).norm();
}

} // namespace bregma::server::testing
