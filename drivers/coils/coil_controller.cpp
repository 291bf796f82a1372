#include "drivers/coils/coil_controller.hpp"

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <string_view>
#include <utility>

#include "base/text.hpp"
#include "casefile/coil_frames.hpp"
#include "idl/commands.hpp"

namespace bregma::coils {

namespace {

using namespace std::chrono_literals;

constexpr std::int64_t kMs_ns = 1'000'000;
constexpr std::int64_t kQuestion_ns = 100 * kMs_ns; // between questions
constexpr std::int64_t kSilence_ns = 1'000 * kMs_ns;
constexpr std::int64_t kAnswer_ns = 500 * kMs_ns; // until the current must have been measured
constexpr std::int64_t kHoldMargin_ms = 500;      // of the two clocks, at the end of a hold
constexpr std::size_t kMaxWaiting = 16;
constexpr std::string_view kOffPattern = "background";

std::string milliamperes(double value_mA) {
  std::string text = std::to_string(std::round(value_mA * 10.0) / 10.0);
  return text.substr(0, text.find('.') + 2) + " mA";
}

} // namespace

void CoilController::declare(base::ParameterSet &parameters) {
  parameters.string("address", &address_, "Of the controller: serial:///DEVICE?baud=N or tcp://HOST:PORT")
      .string("frame", &frame_file_, "File of the registration frame (TOML): names and groups of the coils")
      .number("max_current_mA", &max_current_mA_, "mA", 1.0, 1000.0, "Currents above it are refused")
      .number("max_hold_s", &max_hold_s_, "s", 1.0, 3600.0, "Longer holds are refused")
      .number("tolerance", &tolerance_, "", 0.001, 0.5, "Part by which the measured current may differ");
}

base::Result<void> CoilController::prepare(const driver::Settings &settings) {
  device_ = settings.device;
  if (auto ok = driver::check_address("address", address_); !ok) {
    return ok;
  }
  auto frame = casefile::read_coil_frame(frame_file_);
  if (!frame) {
    return tl::unexpected(frame.error());
  }
  if (frame->coils.size() > 64) {
    return base::failure(frame_file_ + ": the controller has 64 outputs, the frame " +
                         std::to_string(frame->coils.size()) + " coils");
  }
  frame_ = std::move(*frame);
  return {};
}

driver::Outcome<void> CoilController::connect(driver::Io &io) {
  lines_.reset();
  state_.reset();
  pending_.reset();
  waiting_.clear();
  on_ = 0;
  auto opened = stream_.open(address_, io);
  if (!opened) {
    return opened;
  }
  io_ = &io;
  // Orders of before: whoever gave them has taken them for failed. Off is carried out below.
  take_commands(io);
  for (const wire::Command &command : std::exchange(waiting_, {})) {
    const bool off = wire::view(command.body._u.coils.pattern) == kOffPattern;
    if (off) {
      waiting_.push_back(command);
    } else {
      reply(command, bregma_wire_COMMAND_REFUSED, "the controller was not connected when the order came: order again",
            io);
    }
  }
  last_heard_ns_ = io.now_ns();
  next_question_ns_ = 0;
  return send({Order::Kind::kOff}, io); // whatever was on before
}

void CoilController::disconnect() noexcept {
  if (io_ != nullptr) { // the controller's own time-out remains where this does not arrive
    try {
      (void)stream_.write(line_of(Order{Order::Kind::kOff}), *io_, 100ms);
    } catch (...) { // NOLINT(bugprone-empty-catch): out of memory; nothing is left to do
    }
    io_ = nullptr;
  }
  stream_.close();
}

driver::Outcome<void> CoilController::send(const Order &order, driver::Io &io) {
  return stream_.write(line_of(order), io);
}

driver::Outcome<driver::Progress> CoilController::read(driver::Io &io) {
  take_commands(io);
  if (!pending_ && !waiting_.empty()) {
    const wire::Command next = waiting_.front();
    waiting_.pop_front();
    start(next, io);
    if (pending_) {
      if (auto sent = send(pending_->order, io); !sent) {
        return tl::unexpected(sent.error());
      }
    }
  }
  if (io.now_ns() >= next_question_ns_) {
    next_question_ns_ = io.now_ns() + kQuestion_ns;
    if (auto sent = send({Order::Kind::kGet}, io); !sent) {
      return tl::unexpected(sent.error());
    }
  }
  const auto bytes = stream_.read(io, 20ms);
  if (!bytes) {
    return tl::unexpected(bytes.error());
  }
  const std::size_t too_long = lines_.take(*bytes, [&](std::string_view line) {
    const auto state = parse_state(line);
    if (!state) {
      io.skipped(1, state.error());
      return;
    }
    state_ = *state;
    last_heard_ns_ = io.now_ns();
  });
  if (too_long > 0) {
    io.skipped(too_long, "line too long");
  }
  check_pending(io);
  if (on_ != 0 && !pending_ && state_ && state_->coils != on_ && io.now_ns() < on_until_ns_) {
    return driver::retry_later(address_ + ": the controller has switched the coils by itself");
  }
  if (io.now_ns() - last_heard_ns_ > kSilence_ns) {
    return driver::retry_later(address_ + ": the controller does not answer");
  }
  return driver::Progress::kContinue;
}

void CoilController::take_commands(driver::Io &io) {
  io.take<wire::Command>([&](const wire::Command &command) {
    if (wire::view(command.receiver) != device_) {
      return;
    }
    if (command.kind != bregma_wire_COMMAND_SET_COILS) {
      reply(command, bregma_wire_COMMAND_UNSUPPORTED, "a coil controller sets coils only", io);
    } else if (const std::string wrong = wire::malformed(command); !wrong.empty()) {
      reply(command, bregma_wire_COMMAND_MALFORMED, wrong, io);
    } else if (waiting_.size() >= kMaxWaiting) {
      reply(command, bregma_wire_COMMAND_REFUSED, "too many commands wait", io);
    } else {
      waiting_.push_back(command);
    }
  });
}

void CoilController::start(const wire::Command &command, driver::Io &io) {
  const auto &body = command.body._u.coils;
  const auto coils = casefile::coils_of(frame_, wire::text(body.pattern));
  const auto refuse = [&](const std::string &text) { reply(command, bregma_wire_COMMAND_REFUSED, text, io); };
  if (!coils) {
    return refuse(coils.error());
  }
  Order order{Order::Kind::kOff};
  if (*coils != 0) {
    if (!std::isfinite(body.current_mA) || body.current_mA == 0.0 || std::abs(body.current_mA) > max_current_mA_) {
      return refuse("current_mA = " + milliamperes(body.current_mA) + ": must not be 0 and at most " +
                    milliamperes(max_current_mA_));
    }
    if (!(body.hold_s > 0.0) || body.hold_s > max_hold_s_) {
      return refuse("hold_s = " + std::to_string(body.hold_s) + ": must be above 0 and at most " +
                    std::to_string(max_hold_s_));
    }
    order = {Order::Kind::kSet, *coils, std::llround(body.current_mA * 1e3), std::llround(body.hold_s * 1e3)};
  }
  state_.reset(); // an older state is no answer
  on_ = 0;
  pending_ = Pending{command, order, io.now_ns() + kAnswer_ns};
}

void CoilController::check_pending(driver::Io &io) {
  if (!pending_) {
    return;
  }
  const Order &order = pending_->order;
  const double target = static_cast<double>(std::abs(order.current_uA));
  const bool commanded =
      state_ && state_->coils == order.coils && (order.coils == 0 || state_->current_uA == order.current_uA);
  const std::uint64_t dark = commanded ? state_->faults & order.coils : 0;
  const bool late = io.now_ns() >= pending_->deadline_ns;
  // The others carry the current. Coils without are waited for until the deadline.
  const bool measured =
      commanded &&
      (order.coils == 0 || ((dark == 0 || (late && dark != order.coils)) &&
                            std::abs(static_cast<double>(state_->lowest_uA) - target) <= tolerance_ * target &&
                            std::abs(static_cast<double>(state_->highest_uA) - target) <= tolerance_ * target));
  if (measured) {
    reply(pending_->command, bregma_wire_COMMAND_DONE,
          order.coils == 0 ? "all coils off"
                           : (dark != 0 ? "no current in " + names_of(dark) + ": check the cables; " : "") +
                                 names_of(order.coils & ~dark) + " on, " +
                                 milliamperes(static_cast<double>(state_->lowest_uA) * 1e-3) + " to " +
                                 milliamperes(static_cast<double>(state_->highest_uA) * 1e-3) + " measured",
          io);
    on_ = order.coils;
    on_until_ns_ = pending_->deadline_ns - kAnswer_ns + (order.hold_ms - kHoldMargin_ms) * kMs_ns;
    pending_.reset();
  } else if (late) {
    std::string text = "the controller has not confirmed the order";
    if (commanded) {
      text = dark == order.coils ? "no current in " + names_of(dark) + ": check the cables"
                                 : "measured " + milliamperes(static_cast<double>(state_->lowest_uA) * 1e-3) + " to " +
                                       milliamperes(static_cast<double>(state_->highest_uA) * 1e-3) + " instead of " +
                                       milliamperes(target * 1e-3);
    }
    reply(pending_->command, bregma_wire_COMMAND_REFUSED, text, io);
    pending_.reset();
  }
}

std::string CoilController::names_of(std::uint64_t coils) const {
  std::string out;
  for (std::size_t i = 0; i < frame_.coils.size(); ++i) {
    if ((coils >> i & 1U) != 0) {
      out += (out.empty() ? "" : ", ") + frame_.coils[i].name;
    }
  }
  return out.size() > 150 ? out.substr(0, 150) + "..." : out;
}

void CoilController::reply(const wire::Command &command, wire::CommandResult result, const std::string &text,
                           driver::Io &io) const {
  (void)io.publish(wire::reply_to(command, result, text));
}

} // namespace bregma::coils
