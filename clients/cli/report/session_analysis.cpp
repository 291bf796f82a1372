#include "clients/cli/report/session_analysis.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <optional>
#include <string_view>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "algorithms/geometry/unknown.hpp"
#include "clients/cli/report/path_analysis.hpp"
#include "clients/cli/report/scalp_residuals.hpp"
#include "clients/cli/report/tip_analysis.hpp"
#include "clients/cli/report/tissue_analysis.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/names.hpp"

namespace bregma::cli::report {
namespace {

using base::Result;
using casefile::SessionReader;

constexpr std::int64_t kFreshDaemon_ns = 5'000'000'000;

// Limits the length of a text, which may lack its terminator in a damaged file.
template <std::size_t N> std::string bounded(const char (&text)[N]) { return {text, strnlen(text, N)}; }

template <class T, class Visit> Result<void> visit_each(const SessionReader &reader, Visit &&visit) {
  return reader.each<T>(std::forward<Visit>(visit)).map([](std::size_t) {});
}

// ---- commands: checks, verification, states ----

struct Asked {
  wire::CommandKind kind;
  std::string tool;
  std::string point;
};
using CommandKey = std::pair<std::string, std::uint64_t>; // client, id

struct Conversation {
  std::map<CommandKey, Asked> asked;
  std::vector<std::pair<std::int64_t, wire::SessionState>> states;
  std::optional<std::int64_t> first_confirmed_ns;
  std::vector<std::int64_t> registration_starts_ns;
};

Result<void> read_commands(const SessionReader &reader, SessionAnalysis &out, Conversation &talk) {
  auto read = visit_each<wire::Command>(reader, [&](const wire::Command &command, std::int64_t) {
    Asked asked{command.kind, {}, {}};
    if (asked.kind == bregma_wire_COMMAND_CHECK_TOUCH && command.body._d == bregma_wire_FORM_TOUCH) {
      asked.tool = wire::text(command.body._u.touch.tool);
      asked.point = wire::text(command.body._u.touch.point);
    } else if (asked.kind == bregma_wire_COMMAND_FINISH_PIVOT && command.body._d == bregma_wire_FORM_TOOL) {
      asked.tool = wire::text(command.body._u.tool.tool);
    }
    talk.asked[{wire::text(command.client), command.id}] = std::move(asked);
  });
  if (!read) {
    return read;
  }
  return visit_each<wire::CommandReply>(reader, [&](const wire::CommandReply &reply, std::int64_t time_ns) {
    talk.states.emplace_back(time_ns, reply.session);
    const auto found = talk.asked.find({wire::text(reply.client), reply.id});
    const bool done = reply.result == bregma_wire_COMMAND_DONE;
    if (found != talk.asked.end() && found->second.kind == bregma_wire_COMMAND_FINISH_PIVOT) {
      out.pivots.push_back(
          {time_ns, found->second.tool, done, done ? reply.value_mm : geometry::kUnknown, bounded(reply.text)});
    }
    if (found == talk.asked.end() || !done) {
      return;
    }
    const Asked &asked = found->second;
    if (asked.kind == bregma_wire_COMMAND_CHECK_TOUCH) {
      out.checks.push_back({time_ns, asked.tool, asked.point, reply.value_mm, geometry::kUnknown});
    } else if (asked.kind == bregma_wire_COMMAND_CONFIRM_VERIFICATION && !talk.first_confirmed_ns) {
      talk.first_confirmed_ns = time_ns;
    } else if (asked.kind == bregma_wire_COMMAND_START_REGISTRATION) {
      talk.registration_starts_ns.push_back(time_ns);
    }
  });
}

// ---- registration and accuracy ----

Eigen::Matrix4d matrix_of(const wire::Pose &pose) {
  const double *q = pose.rotation_wxyz;
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  out.topLeftCorner<3, 3>() = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
  out.topRightCorner<3, 1>() = Eigen::Map<const Eigen::Vector3d>(pose.translation_mm);
  return out;
}

// From the case's description, which the file contains. A description that cannot be read is as none.
std::optional<std::size_t> count_structures(const SessionReader &reader) {
  const auto names = reader.attachments();
  if (!names || std::find(names->begin(), names->end(), "case.toml") == names->end()) {
    return std::nullopt;
  }
  const auto text = reader.attachment("case.toml");
  if (!text) {
    return std::nullopt;
  }
  std::size_t count = 0;
  constexpr std::string_view kTable = "[[structures]]";
  for (std::size_t at = text->find(kTable); at != std::string::npos; at = text->find(kTable, at + kTable.size())) {
    count += at == 0 || (*text)[at - 1] == '\n' ? 1 : 0;
  }
  return count;
}

Result<void> read_registration(const SessionReader &reader, SessionAnalysis &out,
                               std::optional<wire::RegistrationState> &accepted) {
  std::int64_t accepted_ns = 0;
  auto read =
      visit_each<wire::RegistrationState>(reader, [&](const wire::RegistrationState &state, std::int64_t time_ns) {
        if (state.status == bregma_wire_REGISTRATION_ACCEPTED) {
          const bool again = accepted && accepted->accepted_revision == state.accepted_revision;
          accepted_ns = again ? accepted_ns : time_ns;
          accepted = state;
        }
      });
  if (!read || !accepted) {
    return read;
  }
  out.registration = RegistrationSummary{accepted_ns,
                                         accepted->accepted_revision,
                                         accepted->fiducial_count,
                                         accepted->surface_count,
                                         accepted->fre_mm,
                                         accepted->surface_rms_mm,
                                         matrix_of(accepted->accepted_T_image_reference),
                                         {},
                                         {}};
  auto &residuals = out.registration->residuals;
  return visit_each<wire::FiducialReport>(reader, [&](const wire::FiducialReport &report, std::int64_t) {
    // The last report that used no samples later than the accepted estimate.
    if (report.revision > accepted->accepted_revision) {
      return;
    }
    residuals.clear();
    for (std::size_t i = 0; i < std::min<std::size_t>(report.count, std::size(report.fiducials)); ++i) {
      const auto &one = report.fiducials[i];
      residuals.push_back(
          {wire::text(one.fiducial), one.norm_mm, one.leave_one_out_mm, one.p_value, static_cast<bool>(one.suspect)});
    }
  });
}

Result<void> read_accuracy(const SessionReader &reader, SessionAnalysis &out) {
  return visit_each<wire::AccuracyState>(reader, [&](const wire::AccuracyState &state, std::int64_t time_ns) {
    // The state published right after a check contains the limit of the check.
    for (auto &check : out.checks) {
      if (!std::isfinite(check.limit_mm) && check.time_ns <= time_ns &&
          std::abs(check.distance_mm - state.last_check_mm) < 1e-9) {
        check.limit_mm = state.last_check_limit_mm;
      }
    }
    if (out.registration && state.target_count > 0) {
      auto &targets = out.registration->targets;
      targets.clear();
      for (std::size_t i = 0; i < std::min<std::size_t>(state.target_count, std::size(state.targets)); ++i) {
        const auto &target = state.targets[i];
        targets.push_back(
            {wire::text(target.target), target.tre_rms_mm, target.tre_95.semi_axes_mm[0], target.image_rms_mm});
      }
    }
  });
}

// ---- alarms ----

Result<void> read_alarms(const SessionReader &reader, SessionAnalysis &out) {
  std::map<std::pair<std::string, std::string>, bool> open_critical; // acknowledged by the operator
  auto read = visit_each<wire::Alarm>(reader, [&](const wire::Alarm &alarm, std::int64_t time_ns) {
    const std::pair key{wire::text(alarm.kind), wire::text(alarm.subject)};
    out.alarms.push_back({time_ns, key.first, key.second, std::string(alarm_label(alarm.state)),
                          std::string(severity_label(alarm.severity)), bounded(alarm.text)});
    const auto open = open_critical.find(key);
    if (alarm.state == bregma_wire_ALARM_CLEARED) {
      if (open != open_critical.end()) {
        out.unacknowledged_critical += open->second ? 0 : 1;
        open_critical.erase(open);
      }
    } else if (alarm.severity == bregma_wire_SEVERITY_CRITICAL) {
      out.critical_alarms += open == open_critical.end() ? 1 : 0;
      open_critical[key] = alarm.state == bregma_wire_ALARM_ACKNOWLEDGED;
    }
  });
  for (const auto &[key, seen] : open_critical) {
    out.unacknowledged_critical += seen ? 0 : 1;
  }
  return read;
}

// ---- devices and loops ----

DeviceSummary device_summary(const wire::DeviceHealth &last, const wire::DeviceHealth *first, double live_rate_hz) {
  DeviceSummary out{wire::text(last.device),
                    std::string(device_kind_label(last.kind)),
                    live_rate_hz,
                    last.taken,
                    last.lost,
                    last.late,
                    last.connections,
                    {}};
  if (first != nullptr) {
    out.taken -= std::min(out.taken, std::uint64_t{first->taken});
    out.lost -= std::min(out.lost, std::uint64_t{first->lost});
    out.late -= std::min(out.late, std::uint64_t{first->late});
  }
  for (std::size_t i = 0; i < std::size(last.rejected); ++i) {
    const std::uint64_t before = first != nullptr ? std::min(first->rejected[i], last.rejected[i]) : 0;
    if (last.rejected[i] > before) {
      out.rejected[std::string(reject_label(static_cast<wire::RejectReason>(i)))] += last.rejected[i] - before;
    }
  }
  return out;
}

std::span<const wire::DeviceHealth> devices_of(const wire::SystemHealth &health) {
  return {health.devices, std::min<std::size_t>(health.device_count, std::size(health.devices))};
}

// The health of one process of the daemon: after a restart all counts begin anew.
struct DaemonRun {
  wire::SystemHealth first;
  wire::SystemHealth last;
  // All counts belong to the session if the daemon had just been started.
  [[nodiscard]] bool counts_all() const { return first.time_ns - first.started_time_ns < kFreshDaemon_ns; }
};

void add(const DeviceSummary &more, std::vector<DeviceSummary> &devices) {
  const auto known = std::find_if(devices.begin(), devices.end(),
                                  [&](const DeviceSummary &device) { return device.device == more.device; });
  if (known == devices.end()) {
    devices.push_back(more);
    return;
  }
  known->taken += more.taken;
  known->lost += more.lost;
  known->late += more.late;
  known->connections += more.connections;
  for (const auto &[reason, count] : more.rejected) {
    known->rejected[reason] += count;
  }
}

void add(const wire::LoopHealth &more, std::vector<LoopSummary> &loops) {
  const std::string name = wire::text(more.loop);
  const auto known =
      std::find_if(loops.begin(), loops.end(), [&](const LoopSummary &loop) { return loop.loop == name; });
  if (known == loops.end()) {
    loops.push_back(
        {name, more.rate_hz, more.steps, more.overruns, more.step_p50_us, more.step_p99_us, more.step_max_us});
    return;
  }
  known->steps += more.steps;
  known->overruns += more.overruns;
  known->step_p50_us = more.step_p50_us; // percentiles of several runs cannot be joined: those of the last
  known->step_p99_us = more.step_p99_us;
  known->step_max_us = std::max(known->step_max_us, more.step_max_us);
}

void add(const DaemonRun &run, const std::map<std::string, double> &live_rate_hz, SessionAnalysis &out) {
  for (const auto &device : devices_of(run.last)) {
    const wire::DeviceHealth *before = nullptr;
    for (const auto &candidate : devices_of(run.first)) {
      before = !run.counts_all() && wire::view(candidate.device) == wire::view(device.device) ? &candidate : before;
    }
    const auto rate = live_rate_hz.find(wire::text(device.device));
    add(device_summary(device, before, rate == live_rate_hz.end() ? geometry::kUnknown : rate->second), out.devices);
  }
  out.unknown_device_samples +=
      run.last.unknown_device_samples - (run.counts_all() ? 0 : run.first.unknown_device_samples);
  out.record_dropped += run.last.record_dropped - (run.counts_all() ? 0 : run.first.record_dropped);
  for (std::size_t i = 0; i < std::min<std::size_t>(run.last.loop_count, std::size(run.last.loops)); ++i) {
    add(run.last.loops[i], out.loops);
  }
}

Result<void> read_health(const SessionReader &reader, SessionAnalysis &out, Conversation &talk) {
  std::vector<DaemonRun> runs;
  std::map<std::string, double> live_rate_hz;
  auto read = visit_each<wire::SystemHealth>(reader, [&](const wire::SystemHealth &health, std::int64_t time_ns) {
    if (runs.empty() || runs.back().last.started_time_ns != health.started_time_ns) {
      runs.push_back({health, health});
    }
    runs.back().last = health;
    talk.states.emplace_back(time_ns, health.session);
    for (const auto &device : devices_of(health)) {
      if (device.status == bregma_wire_DEVICE_LIVE && std::isfinite(device.rate_hz)) {
        live_rate_hz[wire::text(device.device)] = device.rate_hz;
      }
    }
  });
  for (const DaemonRun &run : runs) {
    add(run, live_rate_hz, out);
  }
  return read;
}

// ---- whole session ----

void make_state_spans(SessionAnalysis &out, Conversation &talk) {
  std::stable_sort(talk.states.begin(), talk.states.end(),
                   [](const auto &a, const auto &b) { return a.first < b.first; });
  for (const auto &[time_ns, state] : talk.states) {
    const std::string name(session_label(state));
    if (out.states.empty() || out.states.back().state != name) {
      if (!out.states.empty()) {
        out.states.back().to_ns = time_ns;
      }
      out.states.push_back({time_ns, out.end_ns, name});
    }
    if (state == bregma_wire_SESSION_NAVIGATING && !out.navigated) {
      out.navigated = true;
    }
  }
  const auto first_navigating = std::find_if(talk.states.begin(), talk.states.end(), [](const auto &entry) {
    return entry.second == bregma_wire_SESSION_NAVIGATING;
  });
  out.verified_before_navigation = talk.first_confirmed_ns && (first_navigating == talk.states.end() ||
                                                               *talk.first_confirmed_ns <= first_navigating->first);
}

// The session's duration follows from the records of all topics.
Result<void> read_extent(const SessionReader &reader, SessionAnalysis &out) {
  const auto extend = [&](std::int64_t time_ns) {
    out.start_ns = out.start_ns == 0 ? time_ns : std::min(out.start_ns, time_ns);
    out.end_ns = std::max(out.end_ns, time_ns);
  };
  Result<void> read;
  const auto visit = [&]<class T>(std::uint64_t *count = nullptr) {
    if (read) {
      read = visit_each<T>(reader, [&](const T &, std::int64_t time_ns) {
        extend(time_ns);
        if (count != nullptr) {
          ++*count;
        }
      });
    }
  };
  visit.operator()<wire::TrackerFrame>(&out.tracker_frames);
  visit.operator()<wire::SystemHealth>();
  visit.operator()<wire::NavigationState>();
  visit.operator()<wire::CommandReply>();
  visit.operator()<wire::RegistrationState>();
  visit.operator()<wire::Alarm>();
  return read;
}

} // namespace

std::uint64_t SessionAnalysis::rejected_in_all() const {
  std::uint64_t sum = unknown_device_samples;
  for (const auto &device : devices) {
    for (const auto &[reason, count] : device.rejected) {
      sum += count;
    }
  }
  return sum;
}

Result<SessionAnalysis> analyse(const SessionReader &reader) {
  SessionAnalysis out;
  const auto topics = reader.topics();
  if (!topics) {
    return tl::unexpected(topics.error());
  }
  for (const auto &topic : *topics) {
    out.records += topic.count;
  }
  if (out.records == 0) {
    return base::failure("the session file holds no records: nothing was recorded, or it was cut off at once");
  }
  auto meta = reader.meta();
  if (!meta) {
    return tl::unexpected(meta.error());
  }
  out.meta = std::move(*meta);

  out.structures = count_structures(reader);
  read_plans(reader, out);

  Conversation talk;
  std::optional<wire::RegistrationState> accepted;
  const auto read = read_extent(reader, out)
                        .and_then([&] { return read_commands(reader, out, talk); })
                        .and_then([&] { return read_registration(reader, out, accepted); })
                        .and_then([&] { return read_accuracy(reader, out); })
                        .and_then([&] { return read_alarms(reader, out); })
                        .and_then([&] { return read_health(reader, out, talk); })
                        .and_then([&] { return analyse_tips(reader, out); })
                        .and_then([&] { return analyse_tissue(reader, out); });
  if (!read) {
    return tl::unexpected(read.error());
  }
  summarise_path(out);
  make_state_spans(out, talk);
  if (accepted) {
    const auto start =
        std::find_if(talk.registration_starts_ns.rbegin(), talk.registration_starts_ns.rend(),
                     [&](std::int64_t time_ns) { return time_ns <= out.registration->accepted_time_ns; });
    const std::int64_t since_ns = start == talk.registration_starts_ns.rend() ? 0 : *start;
    if (auto traced = measure_trace(reader, *accepted, since_ns, out); !traced) {
      return tl::unexpected(traced.error());
    }
  }
  return out;
}

} // namespace bregma::cli::report
