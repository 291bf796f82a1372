#include "clients/cli/driver_view.hpp"

#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/wire_labels.hpp"

namespace bregma::cli {
namespace {

constexpr std::int64_t kSilent_ns = 2'500'000'000; // a driver speaks once per second

std::string state_of(const live::Received<wire::DriverHealth> &driver, const live::Now &now) {
  const bool silent = driver.state != bregma_wire_DRIVER_STOPPED && now.boot_ns - driver.arrival.boot_ns > kSilent_ns;
  return silent ? "silent" : std::string(driver_state_label(driver.state));
}

} // namespace

std::string drivers_text(const Drivers &drivers, const live::Now &now) {
  Table table({"Driver", "State", "Published", "Refused", "Out of step", "Unreadable", "Clock ms", "Drift ppm",
               "Connects", "Failures"});
  std::string failures;
  for (const auto &[device, driver] : drivers) {
    table.row({printable(device), state_of(driver, now), std::to_string(driver.published),
               std::to_string(driver.refused), std::to_string(driver.out_of_step), std::to_string(driver.skipped),
               fixed(driver.clock_offset_ms, 3), fixed(driver.clock_drift_ppm, 1), std::to_string(driver.connections),
               std::to_string(driver.failures)});
    if (*driver.failure != '\0') {
      failures += "  " + printable(device) + ", latest failure: " + printable(driver.failure) + "\n";
    }
  }
  return table.empty() ? "" : table.text() + failures;
}

nlohmann::json drivers_json(const Drivers &drivers, const live::Now &now) {
  auto out = nlohmann::json::array();
  for (const auto &[device, driver] : drivers) {
    out.push_back({{"device", device},
                   {"state", state_of(driver, now)},
                   {"published", driver.published},
                   {"refused", driver.refused},
                   {"out_of_step", driver.out_of_step},
                   {"unreadable", driver.skipped},
                   {"clock_offset_ms", json_number(driver.clock_offset_ms)},
                   {"clock_drift_ppm", json_number(driver.clock_drift_ppm)},
                   {"clock_resyncs", driver.clock_resyncs},
                   {"connections", driver.connections},
                   {"failures", driver.failures},
                   {"failure", driver.failure}});
  }
  return out;
}

} // namespace bregma::cli
