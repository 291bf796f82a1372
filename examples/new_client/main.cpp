// my-client: prints the state of bregmad once per second: its devices, and the tip of each live tool.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <optional>
#include <string>

#include "idl/boot_clock.hpp"
#include "idl/dds.hpp"
#include "idl/names.hpp"
#include "idl/validity.hpp"

namespace {

using namespace bregma;
using Clock = std::chrono::steady_clock;

const char *name_of(wire::DeviceStatus status) {
  switch (status) {
  case bregma_wire_DEVICE_LIVE:
    return "live";
  case bregma_wire_DEVICE_STALE:
    return "stale";
  case bregma_wire_DEVICE_LOST:
    return "lost";
  default:
    return "never seen";
  }
}

void show(const wire::SystemHealth &health) {
  for (unsigned i = 0; i < health.device_count; ++i) {
    const wire::DeviceHealth &device = health.devices[i];
    std::printf("%s: %s, %.0f samples/s\n", wire::text(device.device).c_str(), name_of(device.status), device.rate_hz);
  }
}

class Tools {
public:
  explicit Tools(const dds::Participant &participant) : states_(participant), transit_(wire::boot_id()) {}
  [[nodiscard]] const dds::Reader<wire::NavigationState> &reader() const { return states_; }

  // Called as samples arrive: the time of this call counts as that of their arrival.
  void take() {
    if (followed_ && !states_.participant_of(*followed_)) {
      followed_.reset(); // its daemon has ended
      shown_.clear();
    }
    states_.take_each([this](const wire::NavigationState &state, const dds::SampleInfo &info) {
      followed_ = followed_.value_or(info.writer);
      if (info.writer != *followed_) {
        std::printf("WARNING: another program publishes poses too\n"); // never mixed with those of the first
      } else if (info.ended || state.ended) {
        shown_.erase(wire::text(state.tool));
      } else {
        const std::int64_t now_ns = wire::boot_now_ns();
        shown_[wire::text(state.tool)] = {state,
                                          {now_ns, transit_.arrived(state.boot_id, state.published_boot_ns, now_ns)}};
      }
    });
    (void)states_.status(); // or a lost writer would keep the wait set awake
  }

  // A pose is shown until its time is over, with the error that it has by then.
  void show() const {
    const std::int64_t now_ns = wire::boot_now_ns();
    for (const auto &[name, tool] : shown_) {
      if (wire::remaining_ns(tool.state, tool.arrival, now_ns) <= 0) {
        std::printf("%s: not live\n", name.c_str());
        continue;
      }
      const double *tip_mm = tool.state.T_image_tip.translation_mm;
      const auto error = wire::tip_error(tool.state, *wire::since_published_ns(tool.arrival, now_ns));
      std::printf("%s: %.1f %.1f %.1f mm (RAS)%s, predicted error %.1f mm RMS\n", name.c_str(), tip_mm[0], tip_mm[1],
                  tip_mm[2], tool.state.status == bregma_wire_POSE_LIVE ? "" : " NOT VERIFIED", error.rms_mm);
    }
  }

private:
  struct Tool {
    wire::NavigationState state;
    wire::Arrival arrival;
  };
  dds::Reader<wire::NavigationState> states_;
  wire::TransitClock transit_;
  std::optional<std::uint64_t> followed_; // the writer that was heard first
  std::map<std::string, Tool> shown_;
};

int watch(std::uint32_t domain, int seconds) {
  const dds::Participant participant(domain);
  dds::Reader<wire::SystemHealth> health(participant);
  Tools tools(participant);
  dds::WaitSet wait(participant);
  wait.attach(tools.reader());
  for (int i = 0; i < seconds; ++i) {
    for (const auto next = Clock::now() + std::chrono::seconds(1); Clock::now() < next;) {
      (void)wait.wait(next - Clock::now());
      tools.take();
    }
    health.take_each([](const wire::SystemHealth &sample, const dds::SampleInfo &) { show(sample); });
    tools.show();
    std::fflush(stdout);
  }
  return 0;
}

} // namespace

int main(int argc, char **argv) {
  if (argc != 3) {
    std::fprintf(stderr, "Usage: my-client DOMAIN SECONDS\nExample: my-client 0 10\n");
    return 2;
  }
  try {
    return watch(static_cast<std::uint32_t>(std::atoi(argv[1])), std::atoi(argv[2]));
  } catch (const dds::Error &error) {
    std::fprintf(stderr, "my-client: %s\n", error.what());
    return 1;
  }
}
