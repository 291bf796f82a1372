// Devices and loops of a SystemHealth, common to `bregma status` and the support bundle. Pure functions; any thread.
#pragma once

#include <cstdint>
#include <span>

#include <nlohmann/json_fwd.hpp>

#include "idl/topics.hpp"

namespace bregma::cli {

// The entries in use. The view is of `health`.
[[nodiscard]] std::span<const wire::DeviceHealth> devices(const wire::SystemHealth &health);
[[nodiscard]] std::span<const wire::LoopHealth> loops(const wire::SystemHealth &health);

// Samples refused for any reason.
[[nodiscard]] std::uint64_t rejected(const wire::DeviceHealth &device);

// Status, counts, rates and times of a device; its name is not among them.
[[nodiscard]] nlohmann::json device_figures_json(const wire::DeviceHealth &device);
[[nodiscard]] nlohmann::json loops_json(const wire::SystemHealth &health);

} // namespace bregma::cli
