// `bregma doctor --bundle`: what a maintainer needs to understand a fault, in one file that may leave the hospital. It
// has no names, no images and no identities: texts of the configuration, of the log and of the daemon are only taken
// over if they are known to be Bregma's own.
#pragma once

#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "base/result.hpp"
#include "idl/topics.hpp"

namespace bregma::cli {

struct BundlePart {
  std::string name; // file in the archive
  std::string content;
};

// A tar archive, compressed by gzip. The file is complete or not there; an existing one is refused.
[[nodiscard]] base::Result<void> write_bundle(const std::filesystem::path &file, std::span<const BundlePart> parts);

// Keys with their numbers, flags and choices. Other texts are replaced by their length, comments are left out.
[[nodiscard]] std::string anonymous_configuration(std::string_view toml);

// Time, level and fixed text of each line: which command, which alarm, and what the daemon says about itself. The rest
// of a line, and lines of an unknown form, are replaced by their length.
[[nodiscard]] std::string anonymous_log(std::string_view log);

// The daemon's counters and times, devices by their kind, and alarms by theirs.
[[nodiscard]] nlohmann::json anonymous_health(const wire::SystemHealth &health, const std::vector<wire::Alarm> &alarms);

// Kernel, distribution, processor, memory; without the machine's name.
[[nodiscard]] std::string machine_text();

// Absolute paths become <path>: they contain the names of users and patients.
[[nodiscard]] std::string without_paths(const std::string &text);

} // namespace bregma::cli
