// Every parameter of bregmad. Units stand in the names; defaults here, ranges and texts in config.cpp.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "algorithms/tissue/brain_model.hpp"
#include "base/parameters.hpp"
#include "base/result.hpp"
#include "case_model/case_tissue.hpp"

namespace bregma::server {

enum class LogLevel { kDebug, kInfo, kWarning, kError };

struct Config {
  std::int64_t domain_id = 0;

  struct {
    std::string trackers = "Tracker"; // names, separated by commas
    std::string robots = "Robot";
    std::string forces = "Force";
    std::string ranges = "Range";
  } devices;

  struct { // the noise that poses are believed to have
    double marker_sigma_lateral_mm = 0.10;
    double marker_sigma_depth_mm = 0.25;
    double latency_ms = 4.0; // exposure to the driver's write, as the manufacturer states it
  } tracker;

  struct {
    double floor_rate_hz = 50.0;
    double filter_hz = 3.0; // motions of a tip up to this are followed; 0: no filter
  } navigation;

  struct {
    double rate_hz = 10.0;
    double correlation_length_mm = 12.0; // of the surface error: neighbouring samples share it
  } registration;

  struct {
    double rate_hz = 10.0;
    double false_alarm_rate = 1e-4; // of the drift test, a check touch
    double raise_after_ms = 200.0;  // a condition holds so long before it is an alarm
    double clear_after_ms = 1000.0; // and is gone so long before the alarm is cleared
    double max_age_ms = 50.0;       // of a pose when it is published; older is an alarm
  } monitoring;

  struct {
    double rate_hz = 60.0;
    std::int64_t elements = 20000; // 0: no tissue model
    double entry_edge_mm = case_model::BrainMeshOptions{}.entry_edge_mm;
    std::int64_t threads = 1;
    std::string material = "thesis";
    bool sliding = true;
    double gap_mm = 0.0;
    double craniotomy_radius_mm = case_model::kCraniotomyRadius_mm;
    double probe_radius_mm = 3.0;
    double rupture_force_N = tissue::InsertionParameters{}.rupture_force_N;
    double cutting_force_N = tissue::InsertionParameters{}.cutting_force_N;
    double shaft_friction_N_per_mm = tissue::InsertionParameters{}.shaft_friction_N_per_mm;
    double field_rate_hz = 10.0; // 0: the displacements of the nodes are not published
  } deformation;

  struct {
    double rate_hz = 2.0;
  } health;

  struct {
    double window_ms = 300.0;
    double max_motion_mm = 1.0;
  } capture;

  struct {
    double spacing_mm = 3.0;
    std::int64_t max_samples = 2000;
  } trace;

  struct {
    double min_rotation_deg = 20.0;
    std::int64_t max_samples = 3000;
  } pivot;

  struct {
    std::int64_t min_checks = 3;
  } verification;

  struct {
    bool enabled = true;
    double commit_ms = 50.0;
    bool truth = true; // record SimulatedTruth when a simulator publishes it
  } recorder;

  struct {
    std::string directory; // empty: $STATE_DIRECTORY (systemd), else $XDG_STATE_HOME/bregma, else ~/.local/state/bregma
  } state;

  struct {
    std::string file; // empty: console only
    LogLevel level = LogLevel::kInfo;
  } log;

  struct {
    bool lock_memory = true;
    std::int64_t navigation_priority = 70; // SCHED_FIFO; 0: leave it to the ordinary scheduler
    std::int64_t registration_priority = 0;
    std::int64_t monitoring_priority = 40;
    std::int64_t deformation_priority = 0; // above it, the solver would take a core from DDS' own threads
  } realtime;
};

// The one declaration of all of them; config must outlive the set.
[[nodiscard]] base::ParameterSet declare(Config &config);
// What ranges alone cannot say: names too long for the wire, a device named twice. Errors name key and value.
[[nodiscard]] base::Result<void> check(const Config &config);
// "A, B" -> {"A", "B"}; empty text: none.
[[nodiscard]] std::vector<std::string> split_names(std::string_view list);
// state.directory, or what stands for it when it is empty.
[[nodiscard]] std::string state_directory(const Config &config);

} // namespace bregma::server
