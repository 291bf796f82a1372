// The simulated scanner as a device of the driver frame: it acquires series on command, streams their slices as
// ImageSlice and, where a folder is given, writes them as DICOM files one by one.
//
// COMMAND_ACQUIRE_SERIES names a protocol: scout, phantom, top, bottom, tree-coronal, tree-sagittal, tree-transverse,
// tree-oblique. The coils follow COMMAND_SET_COILS to the device `coils`, as the simulated frame hangs on that
// controller; with plays_coils the scanner also answers these commands. A series shows the coils as they were when it
// began, off after their hold. Truth is not published: `--write` of bregma-sim-scanner writes it for the same seed.
//
// Images are computed on a thread of their own, one series at a time, so that read() never waits for them.
#pragma once

#include <cstdint>
#include <deque>
#include <future>
#include <optional>
#include <string>
#include <vector>

#include "base/parameters.hpp"
#include "base/result.hpp"
#include "drivers/frame/io.hpp"
#include "drivers/frame/settings.hpp"
#include "drivers/sim/scanner/simulated_scanner.hpp"

namespace bregma::sim::scanner {

class ScannerOnTheWire final : public driver::Device {
public:
  using Writes = driver::Topics<wire::ImageSlice, wire::CommandReply, wire::SimulatedTruth>;
  using Reads = driver::Topics<wire::Command>;

  void declare(base::ParameterSet &parameters) override;
  base::Result<void> prepare(const driver::Settings &settings) override;
  driver::Outcome<void> connect(driver::Io &io) override;
  driver::Outcome<driver::Progress> read(driver::Io &io) override;
  void disconnect() noexcept override {}

private:
  struct Series {
    wire::Command command;
    std::string name;
    Protocol protocol;
    StackPlan plan;
    bool phantom = false;
    std::vector<std::string> on; // groups
    std::uint64_t coils = 0;
    int polarity = 1;
    double current_mA = 0.0;
    std::uint32_t number = 0;
    std::string study_uid, series_uid;
    std::vector<std::uint16_t> pixels; // of the slice that is on the wire
    Stack stack;
    int next = 0;
    std::int64_t due_ns = 0;
  };

  void take_commands(driver::Io &io);
  void set_coils(const wire::Command &command, driver::Io &io);
  void acquire(const wire::Command &command, driver::Io &io);
  void send_due_slices(driver::Io &io);
  void send_slice(Series &series, driver::Io &io);
  void send_truth(const Series &series, driver::Io &io) const; // of the slice before
  [[nodiscard]] base::Result<void> write_file(const Series &series) const;
  void reply(const wire::Command &command, wire::CommandResult result, const std::string &text, driver::Io &io) const;

  std::int64_t seed_ = 1;
  double slice_ms_ = 5.0; // between slices
  double entered_ppm_ = 0.0;
  bool phantom_scanned_ = false, entered_ = false; // used by the worker
  double table_mm_ = 0.0;                          // position of the table, as stated with each slice
  std::string folder_, coils_device_ = "Coils";
  bool plays_coils_ = false, vendor_ = false;
  ScannerOptions options_;

  std::string device_;
  std::unique_ptr<SimulatedScanner> scanner_; // used by the worker while work_ is valid
  std::vector<std::string> groups_on_;
  double current_mA_ = 0.0;
  std::int64_t off_ns_ = 0; // the end of the coils' hold
  std::deque<Series> waiting_;
  std::optional<Series> current_;
  std::future<Stack> work_;
  std::uint32_t series_ = 0;
  std::uint64_t frame_ = 0;
};

} // namespace bregma::sim::scanner
