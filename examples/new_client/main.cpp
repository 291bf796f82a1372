// my-client: prints the state of bregmad once per second: its devices, and the tip of each live tool.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "idl/dds.hpp"
#include "idl/names.hpp"

namespace {

using namespace bregma;

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

// A pose that is not live is NaN: it must not be drawn.
void show(const wire::NavigationState &state) {
  const double *tip_mm = state.T_image_tip.translation_mm;
  if (state.status == bregma_wire_POSE_LIVE) {
    std::printf("%s: %.1f %.1f %.1f mm (RAS), predicted error %.1f mm RMS\n", wire::text(state.tool).c_str(), tip_mm[0],
                tip_mm[1], tip_mm[2], state.tre_rms_mm);
  } else {
    std::printf("%s: not live\n", wire::text(state.tool).c_str());
  }
}

int watch(std::uint32_t domain, int seconds) {
  const dds::Participant participant(domain);
  dds::Reader<wire::SystemHealth> health(participant);
  dds::Reader<wire::NavigationState> navigation(participant);
  for (int i = 0; i < seconds; ++i) {
    std::this_thread::sleep_for(std::chrono::seconds(1)); // readers keep the latest value of each instance
    health.take_each([](const wire::SystemHealth &sample, const dds::SampleInfo &) { show(sample); });
    navigation.take_each([](const wire::NavigationState &sample, const dds::SampleInfo &) { show(sample); });
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
