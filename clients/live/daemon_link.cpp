#include "clients/live/daemon_link.hpp"

#include <algorithm>
#include <random>
#include <utility>

#include <unistd.h>

#include "idl/boot_clock.hpp"

namespace bregma::live {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using base::failure;
using base::Result;

// Makes the client's name unique: two clients with one name would receive each other's replies.
std::string unique_client_name() {
  std::random_device random;
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string suffix;
  for (int i = 0; i < 8; ++i) {
    suffix += kDigits[random() % kDigits.size()];
  }
  return "cli-" + std::to_string(getpid()) + "-" + suffix;
}

std::string seconds_text(DaemonLink::Duration duration) {
  const auto milliseconds = std::chrono::duration_cast<std::chrono::milliseconds>(duration).count();
  return milliseconds % 1000 == 0 ? std::to_string(milliseconds / 1000) + " s" : std::to_string(milliseconds) + " ms";
}

// Readers keep a few samples per instance, so that one of another writer does not displace the followed daemon's.
template <class T> dds::Reader<T> state_reader(const dds::Participant &participant) {
  wire::Qos qos = wire::Topic<T>::kQos;
  qos.depth = 8;
  return dds::Reader<T>(participant, qos);
}

// Its last sample says so, also if the instance exists again since then.
template <class T> bool has_ended(const T &sample, const dds::SampleInfo &info) {
  if constexpr (requires { sample.ended; }) {
    return info.ended || sample.ended;
  }
  return info.ended;
}

template <class T> void store_one(std::optional<T> &place, const T &sample, bool ended) {
  place = ended ? std::nullopt : std::optional(sample);
}

template <class Key, class Value> void store_in(std::map<Key, Value> &map, Key key, const Value &value, bool ended) {
  if (ended) {
    map.erase(key);
  } else {
    map[std::move(key)] = value;
  }
}

Field to_field(const wire::DeformationField &sample) {
  const auto floats = [](const auto &sequence) {
    return std::vector<float>(sequence._buffer, sequence._buffer + sequence._length);
  };
  return {wire::text(sample.model), sample.time_ns, sample.status, floats(sample.displacement_mm),
          floats(sample.von_mises_Pa)};
}

Slice to_slice(const wire::CorrectedSlice &sample, const wire::Arrival &arrival) {
  const auto &pixels = sample.slice.pixels;
  Slice out{sample, std::vector<std::uint16_t>(pixels._buffer, pixels._buffer + pixels._length), arrival};
  out.said.slice.pixels = {};
  return out;
}

// A writer that DDS lost for a while delivers its history again.
void store_capture(Snapshot &said, const wire::CapturedPoint &sample, bool ended) {
  auto &points = said.captures[wire::text(sample.tool)];
  const bool known = std::any_of(points.begin(), points.end(), [&](const wire::CapturedPoint &point) {
    return point.frame == sample.frame && point.kind == sample.kind &&
           point.acquired_time_ns == sample.acquired_time_ns;
  });
  if (ended) {
    points.clear();
  } else if (!known) {
    points.push_back(sample);
  }
  ++said.captures_revision;
}

constexpr std::int64_t kPeersPeriod_ns = 100'000'000;
constexpr std::size_t kMaxWriters = 1024; // remembered; a forgotten one is asked for again

} // namespace

DaemonLink::Pictures::Pictures(const dds::Participant &participant)
    : trackers(participant), captures(participant), scanners(state_reader<wire::ScannerRegistration>(participant)),
      robot_tools(state_reader<wire::RobotTool>(participant)) {}

DaemonLink::DaemonLink(std::uint32_t domain, Role role, double wait_s)
    : domain_(domain), presence_wait_(std::chrono::duration_cast<Duration>(std::chrono::duration<double>(wait_s))),
      client_(unique_client_name()), participant_(domain),
      control_(role == Role::kCommands ? std::optional<Control>(std::in_place, participant_) : std::nullopt),
      registration_(state_reader<wire::RegistrationState>(participant_)),
      fiducials_(state_reader<wire::FiducialReport>(participant_)),
      accuracy_(state_reader<wire::AccuracyState>(participant_)),
      navigation_(state_reader<wire::NavigationState>(participant_)),
      deformation_(state_reader<wire::DeformationState>(participant_)),
      alarms_(state_reader<wire::Alarm>(participant_)), health_(state_reader<wire::SystemHealth>(participant_)),
      drivers_(participant_),
      pictures_(role == Role::kDisplay ? std::optional<Pictures>(std::in_place, participant_) : std::nullopt),
      peers_(participant_), wait_(participant_), now_(Now::read()), daemons_(wire::boot_id()) {
  if (control_) {
    wait_.attach(control_->replies);
  }
  wait_.attach(registration_);
  wait_.attach(fiducials_);
  wait_.attach(accuracy_);
  wait_.attach(navigation_);
  wait_.attach(deformation_);
  wait_.attach(alarms_);
  wait_.attach(health_);
  wait_.attach(drivers_);
  if (pictures_) {
    wait_.attach(pictures_->trackers);
    wait_.attach(pictures_->captures);
    wait_.attach(pictures_->scanners);
    wait_.attach(pictures_->robot_tools);
  }
}

void DaemonLink::want_field(bool wanted) {
  if (!pictures_ || wanted == pictures_->field.has_value()) {
    return;
  }
  if (wanted) {
    pictures_->field.emplace(participant_);
    wait_.attach(*pictures_->field);
  } else {
    pictures_->field.reset();
  }
}

void DaemonLink::want_slices(bool wanted) {
  if (!pictures_ || wanted == pictures_->slices.has_value()) {
    return;
  }
  if (wanted) {
    pictures_->slices.emplace(participant_);
    wait_.attach(*pictures_->slices);
  } else {
    pictures_->slices.reset();
  }
}

base::Error DaemonLink::no_daemon() {
  return {"no bregmad answers on domain " + std::to_string(domain_) + ": " +
          (snapshot().other_wire.empty() ? "is it running?" : snapshot().other_wire)};
}

bool DaemonLink::speaks_our_wire() {
  return snapshot().health && snapshot().health->wire_generation == wire::kWireVersion.generation;
}

bool DaemonLink::is_connected() const {
  const auto &daemon = daemons_.followed_participant();
  return !control_ || (daemon && connects(*daemon));
}

// Commands have readers, and replies have writers, in the devices as well.
bool DaemonLink::connects(const dds::Guid &participant) const {
  return control_->commands.has_reader_of(participant) && control_->replies.has_writer_of(participant);
}

// Nullptr for a sample whose writer has ended.
template <class T> Daemons::Speaker *DaemonLink::speaker_of(const dds::Reader<T> &reader, std::uint64_t writer) {
  auto found = participants_.find(writer);
  if (found == participants_.end()) {
    const auto participant = reader.participant_of(writer);
    if (!participant) {
      return nullptr;
    }
    if (participants_.size() >= kMaxWriters) {
      participants_.clear();
    }
    found = participants_.emplace(writer, *participant).first;
  }
  return &daemons_.heard(found->second, now_.boot_ns);
}

// store(speaker, sample, ended) puts a sample into what its speaker said, or removes an instance that has ended.
template <class T, class Store> std::size_t DaemonLink::take_state(dds::Reader<T> &reader, Store &&store) {
  const std::size_t news = reader.take_each([&](const T &sample, const dds::SampleInfo &info) {
    now_ = Now::read(); // after the sample was taken: it cannot have been published later
    if (auto *speaker = speaker_of(reader, info.writer)) {
      store(*speaker, sample, has_ended(sample, info));
    }
  });
  (void)reader.status(); // clears the status: a change of liveliness would keep the wait set triggered
  return news;
}

std::size_t DaemonLink::take_replies() {
  if (!control_) {
    return 0;
  }
  auto &replies = control_->replies;
  const std::size_t news = replies.take_each([&](const wire::CommandReply &reply, const dds::SampleInfo &info) {
    const auto participant = replies.participant_of(info.writer);
    const bool others =
        participant && daemons_.followed_participant() && participant != daemons_.followed_participant();
    if (wire::view(reply.client) == client_ && (!others || to_devices_.contains(reply.id))) {
      arrived_replies_[reply.id] = reply;
    }
  });
  (void)replies.status();
  return news;
}

std::size_t DaemonLink::take_drivers() {
  const std::size_t news = drivers_.take_each([&](const wire::DriverHealth &sample, const dds::SampleInfo &info) {
    const std::string device = wire::text(sample.device);
    store_in(driver_health_, device, {sample, {now_.boot_ns, std::nullopt}}, info.ended);
    const auto participant = drivers_.participant_of(info.writer);
    if (driver_health_.contains(device) && participant) {
      driver_participants_[device] = *participant;
    } else {
      driver_participants_.erase(device);
    }
  });
  (void)drivers_.status();
  return news;
}

std::size_t DaemonLink::take_pictures() {
  using Speaker = Daemons::Speaker;
  if (!pictures_) {
    return 0;
  }
  auto &trackers = pictures_->trackers;
  std::size_t news = trackers.take_each([&](const wire::TrackerFrame &sample, const dds::SampleInfo &info) {
    store_in(trackers_, wire::text(sample.device), {sample, {now_.boot_ns, std::nullopt}}, info.ended);
  });
  (void)trackers.status();
  news += take_state(pictures_->captures, [](Speaker &speaker, const wire::CapturedPoint &sample, bool ended) {
    store_capture(speaker.said, sample, ended);
  });
  news += take_state(pictures_->scanners, [](Speaker &speaker, const wire::ScannerRegistration &sample, bool ended) {
    store_in(speaker.said.scanners, wire::text(sample.device), sample, ended);
  });
  news += take_state(pictures_->robot_tools, [&](Speaker &speaker, const wire::RobotTool &sample, bool ended) {
    const auto arrival = speaker.arrived(sample.boot_id, sample.published_boot_ns, sample.published_time_ns, now_);
    store_in(speaker.said.robot_tools, wire::text(sample.device), {sample, arrival}, ended);
  });
  if (pictures_->field) {
    news += take_state(*pictures_->field, [](Speaker &speaker, const wire::DeformationField &sample, bool ended) {
      store_one(speaker.said.field, to_field(sample), ended);
      ++speaker.said.field_revision;
    });
  }
  if (pictures_->slices) {
    news += take_state(*pictures_->slices, [&](Speaker &speaker, const wire::CorrectedSlice &sample, bool ended) {
      const auto arrival = speaker.arrived({}, 0, sample.published_time_ns, now_);
      store_in(speaker.said.slices, wire::text(sample.device), to_slice(sample, arrival), ended);
      ++speaker.said.slices_revision;
    });
  }
  return news;
}

bool DaemonLink::take_all() {
  using Speaker = Daemons::Speaker;
  now_ = Now::read();
  std::size_t news = take_state(health_, [&](Speaker &speaker, const wire::SystemHealth &sample, bool) {
    speaker.said.health = {sample, speaker.arrived(sample.boot_id, sample.published_boot_ns, sample.time_ns, now_)};
  });
  news += take_state(navigation_, [&](Speaker &speaker, const wire::NavigationState &sample, bool ended) {
    const auto arrival = speaker.arrived(sample.boot_id, sample.published_boot_ns, sample.published_time_ns, now_);
    store_in(speaker.said.tools, wire::text(sample.tool), {sample, arrival}, ended);
  });
  news += take_state(deformation_, [&](Speaker &speaker, const wire::DeformationState &sample, bool ended) {
    store_in(speaker.said.deformation, wire::text(sample.point), {sample, {now_.boot_ns, std::nullopt}}, ended);
  });
  news += take_state(registration_, [](Speaker &speaker, const auto &sample, bool ended) {
    store_one(speaker.said.registration, sample, ended);
  });
  news += take_state(fiducials_, [](Speaker &speaker, const auto &sample, bool ended) {
    store_one(speaker.said.fiducials, sample, ended);
  });
  news += take_state(accuracy_, [](Speaker &speaker, const auto &sample, bool ended) {
    store_one(speaker.said.accuracy, sample, ended);
  });
  news += take_state(alarms_, [](Speaker &speaker, const wire::Alarm &sample, bool ended) {
    store_in(speaker.said.alarms, {wire::text(sample.kind), wire::text(sample.subject)}, sample, ended);
  });
  news += take_drivers();
  news += take_pictures();
  news += take_replies();
  if (now_.boot_ns >= next_peers_ns_) {
    peers_.update();
    next_peers_ns_ = now_.boot_ns + kPeersPeriod_ns;
  }
  choose();
  return news > 0;
}

void DaemonLink::choose() {
  daemons_.choose(health_.status().writers_alive > 0, now_.boot_ns);
  Snapshot &followed = daemons_.followed();
  followed.drivers = driver_health_;
  followed.trackers = trackers_;
  followed.other_wire = dds::other_wire_text(peers_.of_another_wire());
  followed.mismatches = participant_.mismatches().text();
  followed.other_daemons = others_text();
}

std::string DaemonLink::others_text() const {
  std::string out;
  for (const auto &participant : daemons_.others(now_.boot_ns)) {
    const std::string program = peers_.program_of(participant);
    out += (out.empty() ? "" : ", ") + (program.empty() ? "a program without a name" : program);
  }
  return out.empty() ? out : out + " also writes the topics of the daemon on this domain; the first one is shown";
}

bool DaemonLink::update(Duration timeout) {
  if (take_all()) {
    return true;
  }
  (void)wait_.wait(timeout);
  return take_all();
}

// From another host it takes a moment until a pose's age is known.
bool DaemonLink::transits_known() {
  const auto &tools = snapshot().tools;
  return !tools.empty() && std::all_of(tools.begin(), tools.end(),
                                       [](const auto &tool) { return tool.second.arrival.transit_ns.has_value(); });
}

void DaemonLink::settle(Duration timeout) {
  const auto end = Clock::now() + timeout;
  const auto missing = [](const auto &reader, bool arrived) { return reader.matched_writers() > 0 && !arrived; };
  while (Clock::now() < end &&
         (missing(registration_, snapshot().registration.has_value()) ||
          missing(accuracy_, snapshot().accuracy.has_value()) || missing(navigation_, transits_known()) ||
          missing(health_, snapshot().health.has_value()))) {
    (void)update(20ms);
  }
  // The other instances of a topic follow its first one.
  const auto grace = Clock::now() + 100ms;
  while (Clock::now() < grace) {
    (void)update(20ms);
  }
}

Result<void> DaemonLink::wait_for_daemon(Duration timeout) {
  const auto end = Clock::now() + timeout;
  for (;;) {
    (void)update(10ms);
    const bool there = alive(snapshot(), Now::read().boot_ns) && is_connected();
    if (there && !speaks_our_wire()) {
      return tl::unexpected(no_daemon());
    }
    if (there) {
      return {};
    }
    if (Clock::now() >= end) {
      if (const auto quiet = silence_ns(snapshot(), Now::read().boot_ns); quiet && health_.matched_writers() > 0) {
        return failure("bregmad on domain " + std::to_string(domain_) +
                       " does not respond: its last message was sent " +
                       seconds_text(std::chrono::duration_cast<std::chrono::seconds>(Duration(*quiet))) + " ago");
      }
      return tl::unexpected(no_daemon());
    }
  }
}

bool DaemonLink::wait_for_device(const std::string &device) {
  const auto end = Clock::now() + presence_wait_;
  for (;;) {
    const auto found = driver_participants_.find(device);
    if (found != driver_participants_.end() && connects(found->second)) {
      return true;
    }
    if (Clock::now() >= end) {
      return false;
    }
    (void)update(20ms);
  }
}

Result<wire::CommandReply> DaemonLink::send(wire::Command command, Duration timeout,
                                            const std::function<void(std::uint64_t)> &sent) {
  if (auto there = wait_for_daemon(); !there) {
    return tl::unexpected(there.error());
  }
  (void)wire::set_name(command.client, client_); // it was made to fit
  command.id = next_id_++;
  command.sent_time_ns = Now::read().utc_ns;
  // A motion of an arm is passed on by the daemon, and answered by the arm's driver.
  const std::string device = command.kind == bregma_wire_COMMAND_MOVE_TO_TRAJECTORY
                                 ? wire::text(command.body._u.motion.device)
                                 : wire::text(command.receiver);
  if (!device.empty()) {
    to_devices_.insert(command.id);
    if (!wait_for_device(device)) {
      return failure("no device \"" + device + "\" answers on domain " + std::to_string(domain_) +
                     ": is its driver running?");
    }
  }
  if (!control_->commands.write(command)) {
    return failure("the command could not be sent on domain " + std::to_string(domain_));
  }
  if (sent) {
    sent(command.id);
  }
  const auto end = Clock::now() + timeout;
  for (;;) {
    const auto found = arrived_replies_.find(command.id);
    if (found != arrived_replies_.end()) {
      const wire::CommandReply reply = found->second;
      arrived_replies_.erase(found);
      return reply;
    }
    if (Clock::now() >= end) {
      return failure("bregmad on domain " + std::to_string(domain_) + " did not reply within " + seconds_text(timeout) +
                     "; it is not known whether it carried out the command");
    }
    (void)update(20ms);
  }
}

Result<wire::Command> make_command(wire::CommandKind kind, std::initializer_list<std::string_view> values) {
  wire::Command command{};
  if (const std::string wrong = wire::fill_command(command, kind, values); !wrong.empty()) {
    return failure(wrong);
  }
  return command;
}

} // namespace bregma::live
