#include "tests/network/display.hpp"

#include <chrono>
#include <utility>

#include "idl/boot_clock.hpp"
#include "idl/dds.hpp"
#include "idl/names.hpp"
#include "idl/validity.hpp"

namespace bregma::test {
namespace {

constexpr std::chrono::milliseconds kPeriod{2};

std::int64_t utc_now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

} // namespace

Display::Display(Ethernet &lan, std::size_t host, std::uint32_t domain) {
  lan.run_on(host, [&] { thread_ = std::thread([this, domain] { run(domain); }); });
}

Display::~Display() {
  stopping_ = true;
  thread_.join();
}

void Display::run(std::uint32_t domain) {
  const dds::Participant participant(domain);
  dds::Reader<wire::NavigationState> states(participant);
  dds::WaitSet wait(participant);
  wait.attach(states);
  wire::TransitClock transit(wire::boot_id());
  wire::NavigationState state{};
  wire::Arrival arrival;
  while (!stopping_) {
    (void)wait.wait(kPeriod);
    DisplayRecord record{};
    const std::int64_t arrival_ns = wire::boot_now_ns();
    states.take_each([&](const wire::NavigationState &sample, const dds::SampleInfo &) {
      if (wire::view(sample.tool) == "Probe") {
        state = sample;
        arrival = {arrival_ns, transit.arrived(sample.boot_id, sample.published_boot_ns, arrival_ns)};
        ++record.arrived;
      }
    });
    (void)states.status(); // else the wait set would wake for the same event again and again
    record.time_ns = utc_now_ns();
    shows_ = wire::remaining_ns(state, arrival, wire::boot_now_ns()) > 0;
    record.shown_frame = shows_ ? std::optional(state.frame) : std::nullopt;
    const std::lock_guard lock(mutex_);
    records_.push_back(record);
  }
}

std::vector<DisplayRecord> Display::take_records() {
  const std::lock_guard lock(mutex_);
  return std::exchange(records_, {});
}

Truth::Truth(Ethernet &lan, std::size_t host, std::uint32_t domain) {
  lan.run_on(host, [&] { thread_ = std::thread([this, domain] { run(domain); }); });
}

Truth::~Truth() {
  stopping_ = true;
  thread_.join();
}

void Truth::run(std::uint32_t domain) {
  const dds::Participant participant(domain);
  dds::Reader<wire::SimulatedTruth> truths(participant);
  dds::WaitSet wait(participant);
  wait.attach(truths);
  while (!stopping_) {
    (void)wait.wait(10 * kPeriod);
    truths.take_each([&](const wire::SimulatedTruth &truth, const dds::SampleInfo &) {
      const std::lock_guard lock(mutex_);
      exposed_ns_[truth.frame] = truth.time_ns;
    });
    (void)truths.status();
  }
}

std::optional<std::int64_t> Truth::exposed_ns(std::uint64_t frame) const {
  const std::lock_guard lock(mutex_);
  const auto found = exposed_ns_.find(frame);
  return found != exposed_ns_.end() ? std::optional(found->second) : std::nullopt;
}

} // namespace bregma::test
