// An infrared range sensor on a serial line as a device of the driver frame.
//
// It publishes one RangeSample per reading. A reading that the sensor did not have, or whose line was lost or damaged,
// becomes a sample with that status, so that the stream keeps its rate; after a gap of more than kMaxFilled readings
// only the numbers of the samples jump, and the daemon counts the loss.
//
// The curve belongs to one sensor. A sensor with another serial number than the parameter's gives no sample until a
// person has set the parameter.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "algorithms/range/power_law.hpp"
#include "base/parameters.hpp"
#include "base/result.hpp"
#include "drivers/frame/byte_stream.hpp"
#include "drivers/frame/io.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/frame/settings.hpp"
#include "drivers/range/range_line.hpp"

namespace bregma::range {

// Distance of a triangulating infrared sensor as a power of its voltage, d = scale V^exponent with V in volts: about
// -1.2 for the Sharp GP2Y0A21YK (its data sheet, 10 to 80 cm). bregma calibrate range fits both numbers.
struct PowerCurve {
  PowerLaw law{269.0, -1.19}; // of the voltage; the exponent is below 0
  double near_mm = 100.0, far_mm = 800.0;
  double noise_mV = 5.0; // 1 sigma of a reading
  double sigma_mm = 0.0; // 1 sigma of the curve itself
};

struct Measured {
  wire::RangeStatus status = bregma_wire_RANGE_MISSING;
  double range_mm = wire::kUnknown; // NaN unless RANGE_VALID
  double sigma_mm = wire::kUnknown;
};
// counts: of an ADC of this identity.
[[nodiscard]] Measured measured(const PowerCurve &curve, const Identity &sensor, std::uint32_t counts);

class RangeSensor final : public driver::Device {
public:
  using Writes = driver::Topics<wire::RangeSample>;
  using Reads = driver::Topics<>;

  static constexpr std::uint64_t kMaxFilled = 100;

  void declare(base::ParameterSet &parameters) override;
  base::Result<void> prepare(const driver::Settings &settings) override;
  driver::Outcome<void> connect(driver::Io &io) override;
  driver::Outcome<driver::Progress> read(driver::Io &io) override;
  void disconnect() noexcept override { stream_.close(); }

private:
  // Lines that have arrived. An error if the sensor is not the expected one.
  driver::Outcome<void> take_lines(std::string_view bytes, driver::Io &io);
  driver::Outcome<void> ask(driver::Io &io);
  driver::Outcome<void> check_identity(const Identity &identity, const driver::Io &io);
  void take_reading(const Reading &reading, driver::Io &io);
  void fill_gap(const Reading &next, driver::Io &io);
  void publish(std::uint64_t counter, std::uint64_t time_us, const Measured &value, driver::Io &io) const;

  std::string address_ = "serial:///dev/ttyUSB0?baud=921600";
  std::string serial_number_;
  double period_ms_ = 1.0;
  PowerCurve curve_;

  driver::ByteStream stream_;
  driver::LineSplitter lines_{kMaxLine};
  std::optional<Identity> sensor_; // of this connection, once it is the expected one
  std::optional<Reading> last_;
  std::uint64_t garbled_ = 0; // lines since the last reading
  std::int64_t asked_ns_ = 0;
  std::int64_t identified_ns_ = 0; // or connected
};

} // namespace bregma::range
