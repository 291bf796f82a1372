// The coil controller of a registration frame as a device of the driver frame: a transconductance amplifier behind a
// serial line [Tuna 2022, V-A.2].
//
// It executes COMMAND_SET_COILS. The pattern is "background" (all off), or groups and coils of the frame's file joined
// by "+", as "mid-top+inner-top". The reply comes when the controller has measured the current, or has not within 0.5
// s. A coil without current (an open cable) is named in it: the others are on. If none carries current, the order is
// refused. The controller itself switches off when hold_s has run out, and the driver switches off when it stops. Coils
// that go off before are a lost connection: DriverHealth counts it, and who ordered them on is to look at it.
// Refused, with the coils unchanged: unknown patterns, currents above the limit, holds above the limit, and orders to
// switch on that came while the controller was not connected. Off is always carried out.
#pragma once

#include <deque>
#include <optional>
#include <string>

#include "algorithms/mri/coil_frame.hpp"
#include "base/parameters.hpp"
#include "base/result.hpp"
#include "drivers/coils/coil_line.hpp"
#include "drivers/frame/byte_stream.hpp"
#include "drivers/frame/io.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/frame/settings.hpp"

namespace bregma::coils {

class CoilController final : public driver::Device {
public:
  using Writes = driver::Topics<wire::CommandReply>;
  using Reads = driver::Topics<wire::Command>;

  void declare(base::ParameterSet &parameters) override;
  base::Result<void> prepare(const driver::Settings &settings) override;
  driver::Outcome<void> connect(driver::Io &io) override;
  driver::Outcome<driver::Progress> read(driver::Io &io) override;
  void disconnect() noexcept override;

private:
  struct Pending {
    wire::Command command;
    Order order;
    std::int64_t deadline_ns = 0;
  };
  void take_commands(driver::Io &io);
  void start(const wire::Command &command, driver::Io &io);
  void check_pending(driver::Io &io);
  void reply(const wire::Command &command, wire::CommandResult result, const std::string &text, driver::Io &io) const;
  driver::Outcome<void> send(const Order &order, driver::Io &io);
  [[nodiscard]] std::string names_of(std::uint64_t coils) const;

  std::string address_ = "serial:///dev/ttyUSB0?baud=115200";
  std::string frame_file_ = "frame.toml";
  double max_current_mA_ = 75.0;
  double max_hold_s_ = 1200.0;
  double tolerance_ = 0.05;

  std::string device_;
  mri::CoilFrame frame_;
  driver::ByteStream stream_;
  driver::LineSplitter lines_{kMaxLine};
  std::optional<Pending> pending_;
  std::deque<wire::Command> waiting_;
  std::optional<State> state_;
  std::uint64_t on_ = 0;         // coils that were confirmed to be on
  std::int64_t on_until_ns_ = 0; // the end of their hold
  std::int64_t last_heard_ns_ = 0;
  std::int64_t next_question_ns_ = 0;
  driver::Io *io_ = nullptr; // between connect and disconnect
};

} // namespace bregma::coils
