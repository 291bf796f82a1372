// What the drivers say about themselves (topic DriverHealth), for `bregma status`. A driver that has been silent for
// two of its periods is shown as silent, whatever its last word was.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "clients/live/snapshot.hpp"

namespace bregma::cli {

using Drivers = std::map<std::string, live::Received<wire::DriverHealth>>; // by device

// A table and the latest failure of each; empty where there are no drivers on the frame.
[[nodiscard]] std::string drivers_text(const Drivers &drivers, const live::Now &now);
[[nodiscard]] nlohmann::json drivers_json(const Drivers &drivers, const live::Now &now);

} // namespace bregma::cli
