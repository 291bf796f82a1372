#include "server/config.hpp"

#include <cstdlib>
#include <set>

#include "idl/names.hpp"

namespace bregma::server {

base::ParameterSet declare(Config &c) {
  base::ParameterSet set("bregmad");
  set.integer("domain_id", &c.domain_id, "", 0, 230,
              "DDS domain. Processes on different domains do not see each other.");

  set.string("devices.trackers", &c.devices.trackers,
             "Trackers that are listened to, by name, separated by commas. A sample of any other is rejected.");
  set.string("devices.robots", &c.devices.robots, "Robots, by name, separated by commas.");
  set.string("devices.forces", &c.devices.forces, "Force sensors, by name, separated by commas.");
  set.string("devices.ranges", &c.devices.ranges, "Range sensors, by name, separated by commas.");

  set.number("tracker.marker_sigma_lateral_mm", &c.tracker.marker_sigma_lateral_mm, "mm", 0.001, 5,
             "Error of a marker across the line of sight, 1 sigma of a coordinate. Every predicted error begins here.");
  set.number("tracker.marker_sigma_depth_mm", &c.tracker.marker_sigma_depth_mm, "mm", 0.001, 10,
             "Error of a marker along the line of sight, 1 sigma.");
  set.number("tracker.latency_ms", &c.tracker.latency_ms, "ms", 0, 500,
             "From exposure to the driver's write, as the manufacturer states it.");

  set.number("navigation.floor_rate_hz", &c.navigation.floor_rate_hz, "Hz", 1, 1000,
             "The navigation state is published at least this often, also when no frame comes.");
  set.number("navigation.filter_hz", &c.navigation.filter_hz, "Hz", 0, 50,
             "Motions of a tip up to this are followed, what is faster is averaged as marker noise; 0: no filter.");

  set.number("registration.rate_hz", &c.registration.rate_hz, "Hz", 0.5, 100, "Rate of re-estimation.");
  set.number("registration.correlation_length_mm", &c.registration.correlation_length_mm, "mm", 0.1, 100,
             "Surface samples nearer than this share their error (skin, segmentation) and count for less.");

  set.number("monitoring.rate_hz", &c.monitoring.rate_hz, "Hz", 0.5, 100, "Rate of the monitoring loop.");
  set.number("monitoring.false_alarm_rate", &c.monitoring.false_alarm_rate, "", 1e-9, 0.1,
             "Chance, a check touch, of a drift alarm where nothing has moved.");
  set.number("monitoring.raise_after_ms", &c.monitoring.raise_after_ms, "ms", 0, 60000,
             "A condition that holds for so long becomes an alarm.");
  set.number("monitoring.clear_after_ms", &c.monitoring.clear_after_ms, "ms", 0, 60000,
             "An alarm whose condition is gone for so long is cleared.");
  set.number("monitoring.max_age_ms", &c.monitoring.max_age_ms, "ms", 1, 10000,
             "A pose that is older than this when it is published is an alarm.");

  set.number("deformation.rate_hz", &c.deformation.rate_hz, "Hz", 0.5, 200, "Rate of the deformation loop.");
  set.integer("deformation.elements", &c.deformation.elements, "", 0, 200000,
              "About so many tetrahedra fill the brain; 0: no tissue model.");
  set.number("deformation.entry_edge_mm", &c.deformation.entry_edge_mm, "mm", 0, 20,
             "Longest edge of the tetrahedra where a trajectory enters the brain; those are on top. 0: as elsewhere.");
  set.integer("deformation.threads", &c.deformation.threads, "", 1, 16, "Threads that step the tissue model together.");
  std::vector<std::string> materials;
  for (const tissue::Material &material : tissue::named_materials()) {
    materials.push_back(material.name);
  }
  set.choice("deformation.material", &c.deformation.material, materials,
             "What the brain is made of, where the case does not say.");
  set.flag("deformation.sliding", &c.deformation.sliding,
           "The brain slides along the skull; else it is fixed to it except under the craniotomy.");
  set.number("deformation.gap_mm", &c.deformation.gap_mm, "mm", 0, 20, "Fluid between brain and skull.");
  set.number("deformation.craniotomy_radius_mm", &c.deformation.craniotomy_radius_mm, "mm", 0, 100,
             "Of the opening around the first trajectory's way into the brain, where the case does not say.");
  set.number("deformation.probe_radius_mm", &c.deformation.probe_radius_mm, "mm", 0.2, 20, "Of the probe's shaft.");
  set.number("deformation.rupture_force_N", &c.deformation.rupture_force_N, "N", 0.001, 100,
             "Along the probe, at which the brain's surface breaks.");
  set.number("deformation.cutting_force_N", &c.deformation.cutting_force_N, "N", 0, 100,
             "At the tip, as it goes on after the rupture.");
  set.number("deformation.shaft_friction_N_per_mm", &c.deformation.shaft_friction_N_per_mm, "N/mm", 0, 10,
             "Of the shaft in the tissue.");
  set.number("deformation.field_rate_hz", &c.deformation.field_rate_hz, "Hz", 0, 60,
             "Rate at which the displacements of all nodes are published; 0: never.");
  set.number("health.rate_hz", &c.health.rate_hz, "Hz", 0.5, 50, "Rate at which the system's health is published.");

  set.number("capture.window_ms", &c.capture.window_ms, "ms", 20, 5000,
             "A touch is the mean of the tip over this time.");
  set.number("capture.max_motion_mm", &c.capture.max_motion_mm, "mm", 0.05, 20,
             "A touch whose tip strays further than this from its mean was not held still and is refused.");

  set.number("trace.spacing_mm", &c.trace.spacing_mm, "mm", 0.1, 50,
             "A surface sample is taken wherever the tip is so far from the last one.");
  set.integer("trace.max_samples", &c.trace.max_samples, "", 10, 2000,
              "Surface samples that are kept; then the trace ends.");

  set.number("pivot.min_rotation_deg", &c.pivot.min_rotation_deg, "deg", 5, 180,
             "A tool that turned by less about either of two axes is not calibrated.");
  set.integer("pivot.max_samples", &c.pivot.max_samples, "", 50, 20000,
              "Poses that are kept of one pivot; later ones are ignored.");

  set.integer("verification.min_checks", &c.verification.min_checks, "", 1, 64,
              "Landmarks that must be touched after a registration was accepted before it can be confirmed.");

  set.flag("recorder.enabled", &c.recorder.enabled, "Record everything in and out to a session file.");
  set.number("recorder.commit_ms", &c.recorder.commit_ms, "ms", 5, 100,
             "Records are committed to disk this often; a killed daemon loses at most twice as much.");
  set.flag("recorder.truth", &c.recorder.truth, "Record the truth too when a simulator publishes it.");

  set.string("state.directory", &c.state.directory,
             "Where the session is kept for a restart. Empty: $STATE_DIRECTORY, else $XDG_STATE_HOME/bregma, else "
             "~/.local/state/bregma.");

  set.string("log.file", &c.log.file, "Log file beside the console; empty: none.");
  set.choice("log.level", &c.log.level,
             {{"debug", LogLevel::kDebug},
              {"info", LogLevel::kInfo},
              {"warning", LogLevel::kWarning},
              {"error", LogLevel::kError}},
             "What is logged.");

  set.flag("realtime.lock_memory", &c.realtime.lock_memory,
           "Lock the process in memory; without the right to do so it is logged and left.");
  const auto priority = [&set](const char *key, std::int64_t *value, const char *loop) {
    set.integer(key, value, "", 0, 98,
                std::string("SCHED_FIFO priority of the ") + loop + " loop; 0: the ordinary scheduler.");
  };
  priority("realtime.navigation_priority", &c.realtime.navigation_priority, "navigation");
  priority("realtime.registration_priority", &c.realtime.registration_priority, "registration");
  priority("realtime.monitoring_priority", &c.realtime.monitoring_priority, "monitoring");
  priority("realtime.deformation_priority", &c.realtime.deformation_priority, "deformation");
  return set;
}

namespace {

std::string name_problem(const std::string &name, const std::set<std::string> &seen) {
  if (name.empty()) {
    return "has an empty name between commas";
  }
  if (name.size() > wire::kNameLength) {
    return "\"" + name + "\" is longer than " + std::to_string(wire::kNameLength) +
           " bytes, which the wire would have to cut";
  }
  return seen.contains(name) ? "\"" + name + "\" is named twice" : "";
}

} // namespace

base::Result<void> check(const Config &config) {
  std::set<std::string> seen;
  const std::pair<const char *, const std::string *> lists[] = {{"devices.trackers", &config.devices.trackers},
                                                                {"devices.robots", &config.devices.robots},
                                                                {"devices.forces", &config.devices.forces},
                                                                {"devices.ranges", &config.devices.ranges}};
  for (const auto &[key, list] : lists) {
    for (const std::string &name : split_names(*list)) {
      if (const std::string problem = name_problem(name, seen); !problem.empty()) {
        return base::failure(std::string(key) + " = \"" + *list + "\": " + problem);
      }
      seen.insert(name);
    }
  }
  if (split_names(config.devices.trackers).empty()) {
    return base::failure("devices.trackers = \"\": at least one tracker is needed");
  }
  if (seen.size() > bregma_wire_MAX_DEVICES) {
    return base::failure("devices: " + std::to_string(seen.size()) + " are named, at most " +
                         std::to_string(bregma_wire_MAX_DEVICES) + " can be shown");
  }
  return {};
}

std::vector<std::string> split_names(std::string_view list) {
  constexpr std::string_view kBlank = " \t";
  std::vector<std::string> names;
  if (list.find_first_not_of(kBlank) == std::string_view::npos) {
    return names;
  }
  while (true) {
    const std::size_t comma = list.find(',');
    std::string_view name = list.substr(0, comma);
    name.remove_prefix(std::min(name.find_first_not_of(kBlank), name.size()));
    name = name.substr(0, name.find_last_not_of(kBlank) + 1); // npos + 1 == 0: nothing but blanks
    names.emplace_back(name);
    if (comma == std::string_view::npos) {
      return names;
    }
    list.remove_prefix(comma + 1);
  }
}

std::string state_directory(const Config &config) {
  const auto variable = [](const char *name) {
    const char *value = std::getenv(name);
    return std::string(value != nullptr ? value : "");
  };
  if (!config.state.directory.empty()) {
    return config.state.directory;
  }
  if (const std::string systemd = variable("STATE_DIRECTORY"); !systemd.empty()) {
    return systemd.substr(0, systemd.find(':')); // systemd lists several with colons; ours is the first
  }
  if (const std::string home = variable("XDG_STATE_HOME"); !home.empty()) {
    return home + "/bregma";
  }
  return variable("HOME") + "/.local/state/bregma";
}

} // namespace bregma::server
