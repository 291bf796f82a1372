// The simulated scanner as a device: series on command, the coils' state in them, and the DICOM files beside them.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <set>
#include <vector>

#include "casefile/volumes/volume.hpp"
#include "drivers/frame/system_host.hpp"
#include "drivers/sim/scanner/scanner_on_the_wire.hpp"
#include "idl/commands.hpp"
#include "tests/unit/casefile/files.hpp"

namespace bregma::sim::scanner::test {

namespace {

struct Received {
  wire::ImageSlice header;
  std::vector<std::uint16_t> pixels;
};

class ScannerBus final : public driver::Bus {
public:
  bool write(std::string_view topic, const void *sample) override {
    if (topic == wire::Topic<wire::ImageSlice>::kName) {
      const auto &slice = *static_cast<const wire::ImageSlice *>(sample);
      slices.push_back({slice, {slice.pixels._buffer, slice.pixels._buffer + slice.pixels._length}});
    } else if (topic == wire::Topic<wire::CommandReply>::kName) {
      replies.push_back(*static_cast<const wire::CommandReply *>(sample));
    } else if (topic == wire::Topic<wire::SimulatedTruth>::kName) {
      truths.push_back(*static_cast<const wire::SimulatedTruth *>(sample));
    }
    return true;
  }
  void take(std::string_view /*topic*/, const std::function<void(const void *)> &visit) override {
    for (const wire::Command &c : std::exchange(commands, {})) {
      visit(&c);
    }
  }
  [[nodiscard]] std::uint32_t matched(std::string_view /*topic*/) const override { return 1; }

  std::vector<wire::Command> commands;
  std::vector<wire::CommandReply> replies;
  std::vector<Received> slices;
  std::vector<wire::SimulatedTruth> truths;
};

class Wire : public testing::Test {
protected:
  void start(const std::vector<std::string> &settings) {
    base::ParameterSet parameters("bregma-sim-mri");
    device.declare(parameters);
    for (const std::string &s : settings) {
      ASSERT_TRUE(parameters.set_from_string(s)) << s;
    }
    driver::Settings frame;
    frame.device = "Scanner";
    ASSERT_TRUE(device.prepare(frame));
    ASSERT_TRUE(device.connect(io));
  }
  // Runs until the command is answered.
  wire::CommandReply send(bregma_wire_CommandKind kind, std::initializer_list<std::string_view> values,
                          const char *receiver) {
    wire::Command command{};
    EXPECT_EQ(wire::fill_command(command, kind, values), "");
    EXPECT_TRUE(wire::set_name(command.receiver, receiver));
    command.id = ++id;
    bus.commands.push_back(command);
    const std::size_t before = bus.replies.size();
    for (int i = 0; i < 20000 && bus.replies.size() == before; ++i) {
      EXPECT_TRUE(device.read(io));
    }
    if (bus.replies.size() == before) {
      ADD_FAILURE() << "no reply";
      return {};
    }
    EXPECT_EQ(bus.replies.back().id, id);
    return bus.replies.back();
  }

  ScannerBus bus;
  driver::SystemHost host;
  driver::Status status;
  driver::Io io{bus, host, status, {.device = "Scanner"}};
  ScannerOnTheWire device;
  std::uint64_t id = 0;
};

} // namespace

TEST_F(Wire, SeriesCarryTheStateOfTheCoilsAndMatchTheirFiles) {
  const bregma::test::TemporaryFolder folder;
  start({"folder=" + folder.path().string(), "plays_coils=true", "slice_ms=0", "seed=5"});
  ASSERT_EQ(send(bregma_wire_COMMAND_ACQUIRE_SERIES, {"Scanner", "top", "6"}, "Scanner").result,
            bregma_wire_COMMAND_DONE);
  ASSERT_EQ(send(bregma_wire_COMMAND_SET_COILS, {"Coils", "mid-top", "-75", "60"}, "Coils").result,
            bregma_wire_COMMAND_DONE);
  const auto done = send(bregma_wire_COMMAND_ACQUIRE_SERIES, {"Scanner", "top", "6"}, "Scanner");
  EXPECT_STREQ(done.text, "series 2: 6 slices of top");
  ASSERT_EQ(bus.slices.size(), 12U);
  for (std::size_t i = 0; i < 12; ++i) {
    const wire::ImageSlice &slice = bus.slices[i].header;
    EXPECT_EQ(slice.frame, i + 1);
    EXPECT_EQ(slice.series, i / 6 + 1);
    EXPECT_EQ(slice.index, i % 6 + 1);
    EXPECT_EQ(slice.count, 6U);
    EXPECT_EQ(slice.coil_state, i < 6 ? bregma_wire_COILS_OFF : bregma_wire_COILS_NEGATIVE);
    EXPECT_EQ(slice.coils_on, i < 6 ? 0U : 0xF0U); // coils 4 to 7 of the design
    EXPECT_EQ(slice.coil_current_mA, i < 6 ? 0.0 : 75.0);
    EXPECT_EQ(slice.correction, bregma_wire_CORRECTION_NONE);
  }
  // Current takes signal away.
  double lost = 0.0;
  for (std::size_t p = 0; p < bus.slices[2].pixels.size(); ++p) {
    lost = std::max(lost, static_cast<double>(bus.slices[2].pixels[p]) - bus.slices[8].pixels[p]);
  }
  EXPECT_GT(lost, 600.0);

  // The DICOM series is the same image: each pixel where the wire says that it is.
  casefile::Notes notes;
  const auto volume = casefile::read_volume(folder.path() / "2-top", {}, &notes);
  ASSERT_TRUE(volume) << volume.error().message;
  const Eigen::Matrix4d T_index_ras = volume->T_image_index.inverse();
  for (std::size_t i = 6; i < 12; ++i) {
    const wire::ImageSlice &slice = bus.slices[i].header;
    const auto T = wire::from_wire<frame::Device, frame::Body>(slice.T_scanner_slice);
    for (const auto &[column, row] : {std::pair(0, 0), std::pair(100, 37), std::pair(191, 191), std::pair(60, 120)}) {
      const Vector3d p = T * Vector3d(column * slice.spacing_mm[0], row * slice.spacing_mm[1], 0.0);
      const Vector3d ras(-p.x(), p.y(), -p.z());
      const Vector3d index = T_index_ras.topLeftCorner<3, 3>() * ras + T_index_ras.topRightCorner<3, 1>();
      EXPECT_LT((index - index.array().round().matrix()).norm(), 1e-3);
      const auto pixel = static_cast<std::size_t>(row) * slice.columns + static_cast<std::size_t>(column);
      EXPECT_EQ(volume->at(static_cast<int>(std::lround(index.x())), static_cast<int>(std::lround(index.y())),
                           static_cast<int>(std::lround(index.z()))),
                static_cast<float>(bus.slices[i].pixels[pixel]));
    }
  }
}

TEST_F(Wire, CoilsAreOffAfterTheirHold) {
  start({"plays_coils=true", "slice_ms=0", "seed=5"});
  ASSERT_EQ(send(bregma_wire_COMMAND_SET_COILS, {"Coils", "mid-top", "75", "0.000001"}, "Coils").result,
            bregma_wire_COMMAND_DONE);
  ASSERT_EQ(send(bregma_wire_COMMAND_ACQUIRE_SERIES, {"Scanner", "top", "1"}, "Scanner").result,
            bregma_wire_COMMAND_DONE);
  ASSERT_EQ(bus.slices.size(), 1U);
  EXPECT_EQ(bus.slices[0].header.coil_state, bregma_wire_COILS_OFF);
  EXPECT_EQ(bus.slices[0].header.coils_on, 0U);
}

TEST_F(Wire, TheTruthOfEachSliceIsOnTheTruthTopicAlone) {
  start({"slice_ms=0", "seed=5"});
  ASSERT_EQ(send(bregma_wire_COMMAND_ACQUIRE_SERIES, {"Scanner", "scout", "2"}, "Scanner").result,
            bregma_wire_COMMAND_DONE);
  ASSERT_EQ(bus.truths.size(), 2U);
  const SimulatedScanner same({}, 5);
  for (std::size_t i = 0; i < 2; ++i) {
    const wire::SimulatedTruth &truth = bus.truths[i];
    EXPECT_STREQ(truth.device, "Scanner");
    EXPECT_EQ(truth.frame, bus.slices[i].header.frame);
    EXPECT_EQ(truth.seed, 5U);
    EXPECT_TRUE(std::isnan(truth.T_image_reference.translation_mm[0]));
    ASSERT_EQ(truth.tool_count, 2U);
    EXPECT_STREQ(truth.tools[0].tool, "Registration frame");
    const auto T = wire::from_wire<frame::Device, frame::Body>(truth.tools[0].T_tracker_tool);
    EXPECT_LT((T.translation() - same.truth().T_device_base.translation()).norm(), 1e-9);
    EXPECT_STREQ(truth.tools[1].tool, "Phantom");
  }
}

TEST_F(Wire, EveryProtocolHasItsReadOutReversed) {
  start({"plays_coils=true", "slice_ms=0", "seed=5"});
  for (const char *protocol : {"scout", "scout-reversed"}) {
    ASSERT_EQ(send(bregma_wire_COMMAND_ACQUIRE_SERIES, {"Scanner", protocol, "2"}, "Scanner").result,
              bregma_wire_COMMAND_DONE);
  }
  ASSERT_EQ(bus.slices.size(), 4U);
  EXPECT_EQ(bus.slices[0].header.read_out, bregma_wire_DIRECTION_ROW_POSITIVE);
  EXPECT_EQ(bus.slices[2].header.read_out, bregma_wire_DIRECTION_ROW_NEGATIVE);
  EXPECT_EQ(bus.slices[2].header.bandwidth_Hz_per_pixel, bus.slices[0].header.bandwidth_Hz_per_pixel);
  EXPECT_STREQ(bus.slices[2].header.protocol, "scout-reversed");
  EXPECT_EQ(send(bregma_wire_COMMAND_ACQUIRE_SERIES, {"Scanner", "-reversed", "2"}, "Scanner").result,
            bregma_wire_COMMAND_REFUSED);
}

TEST_F(Wire, WhatItCannotDoIsRefusedByName) {
  start({});
  EXPECT_STREQ(send(bregma_wire_COMMAND_ACQUIRE_SERIES, {"Scanner", "spine", "0"}, "Scanner").text,
               "protocol \"spine\" is not known to this scanner");
  EXPECT_STREQ(send(bregma_wire_COMMAND_ACQUIRE_SERIES, {"Scanner", "top", "401"}, "Scanner").text,
               "slices: at most 400");
  EXPECT_EQ(send(bregma_wire_COMMAND_STOP_ROBOT, {"Scanner"}, "Scanner").result, bregma_wire_COMMAND_UNSUPPORTED);
  EXPECT_TRUE(bus.slices.empty());
}

} // namespace bregma::sim::scanner::test
