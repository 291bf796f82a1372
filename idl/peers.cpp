#include "idl/peers.hpp"

#include <algorithm>
#include <cstring>
#include <string_view>

#include <ddsc/dds.h>

namespace bregma::dds {
namespace {

Guid guid_of(const dds_guid_t &from) {
  Guid out;
  std::memcpy(out.data(), from.v, out.size());
  return out;
}

bool is_topic(std::string_view name) {
#define BREGMA_NAME_OF(Type, qos) wire::Topic<wire::Type>::kName,
  static constexpr std::string_view kNames[] = {BREGMA_TOPICS(BREGMA_NAME_OF)};
#undef BREGMA_NAME_OF
  return std::find(std::begin(kNames), std::end(kNames), name) != std::end(kNames);
}

// Keeps texts from unknown participants short and printable.
std::string printable(std::string text) {
  constexpr std::size_t kLongest = 63;
  text.resize(std::min(text.size(), kLongest));
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

std::optional<wire::Announcement> announcement_of(const dds_qos_t *qos) {
  void *data = nullptr;
  std::size_t size = 0;
  if (qos == nullptr || !dds_qget_userdata(qos, &data, &size) || data == nullptr) {
    return std::nullopt;
  }
  auto out = wire::from_user_data({static_cast<const char *>(data), size});
  dds_free(data);
  return out;
}

Entity make_reader(const Participant &participant, dds_entity_t topic) {
  const std::int32_t handle = dds_create_reader(participant.handle(), topic, nullptr, nullptr);
  if (handle < 0) {
    throw Error(std::string("DDS: cannot read who is on the domain: ") + dds_strretcode(handle));
  }
  return Entity(handle);
}

// Calls visit(sample, alive) for all samples of a reader of a built-in topic.
template <class Sample, class Visit> void take_builtin(const Entity &reader, Visit &&visit) {
  constexpr int kBatch = 32;
  int count = kBatch;
  while (count == kBatch) {
    void *samples[kBatch] = {};
    dds_sample_info_t infos[kBatch];
    count = dds_take(reader.handle(), samples, infos, kBatch, kBatch);
    for (int i = 0; i < count; ++i) {
      visit(*static_cast<const Sample *>(samples[i]), infos[i].valid_data && infos[i].instance_state == DDS_IST_ALIVE);
    }
    if (count > 0) {
      (void)dds_return_loan(reader.handle(), samples, count);
    }
  }
}

} // namespace

std::string Peer::text() const {
  const std::string name = !program.empty() ? program : is_daemon ? "a bregmad" : "a program";
  return version ? name + " speaks wire " + wire::text_of(*version)
                 : name + " states no wire version (releases before wire 2.0 do not)";
}

struct Peers::Impl {
  explicit Impl(const Participant &participant)
      : participants(make_reader(participant, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT)),
        publications(make_reader(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION)),
        subscriptions(make_reader(participant, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION)) {}

  struct Endpoint {
    Guid participant;
    bool writes_health;
  };
  void take_endpoints(const Entity &reader, bool writes) {
    take_builtin<dds_builtintopic_endpoint_t>(reader, [&](const dds_builtintopic_endpoint_t &endpoint, bool alive) {
      const Guid key = guid_of(endpoint.key);
      if (!alive) {
        endpoints.erase(key);
      } else if (is_topic(endpoint.topic_name)) {
        const bool health = writes && std::string_view(endpoint.topic_name) == wire::Topic<wire::SystemHealth>::kName;
        endpoints[key] = {guid_of(endpoint.participant_key), health};
      }
    });
  }

  Entity participants;
  Entity publications;
  Entity subscriptions;
  std::map<Guid, std::optional<wire::Announcement>> announced; // per participant
  std::map<Guid, Endpoint> endpoints;                          // endpoints of Bregma's topics
};

Peers::Peers(const Participant &participant) : impl_(std::make_unique<Impl>(participant)) { update(); }
Peers::~Peers() = default;

void Peers::update() {
  take_builtin<dds_builtintopic_participant_t>(impl_->participants,
                                               [this](const dds_builtintopic_participant_t &participant, bool alive) {
                                                 const Guid key = guid_of(participant.key);
                                                 if (alive) {
                                                   impl_->announced[key] = announcement_of(participant.qos);
                                                 } else {
                                                   impl_->announced.erase(key);
                                                 }
                                               });
  impl_->take_endpoints(impl_->publications, true);
  impl_->take_endpoints(impl_->subscriptions, false);
}

std::string Peers::program_of(const Guid &participant) const {
  const auto found = impl_->announced.find(participant);
  const bool stated = found != impl_->announced.end() && found->second;
  return stated ? printable(found->second->program) : std::string();
}

std::vector<Peer> Peers::of_another_wire() const {
  std::map<Guid, Peer> peers;
  for (const auto &[key, endpoint] : impl_->endpoints) {
    const auto found = impl_->announced.find(endpoint.participant);
    if (found == impl_->announced.end()) {
      continue; // the participant itself is not known yet, or has ended
    }
    const auto &announcement = found->second;
    if (announcement && announcement->version.generation == wire::kWireVersion.generation) {
      continue;
    }
    Peer &peer = peers[endpoint.participant];
    peer.is_daemon = peer.is_daemon || endpoint.writes_health;
    if (announcement) {
      peer.program = printable(announcement->program);
      peer.version = announcement->version;
    }
  }
  std::vector<Peer> out;
  for (auto &[guid, peer] : peers) {
    out.push_back(std::move(peer));
  }
  return out;
}

std::string other_wire_text(const std::vector<Peer> &peers) {
  std::string out;
  for (const Peer &peer : peers) {
    const std::string text = peer.text();
    if (out.find(text) == std::string::npos) { // several of one kind are reported once
      out += text + ", ";
    }
  }
  return out.empty()
             ? out
             : out + "this program speaks wire " + wire::text_of(wire::kWireVersion) + ": install one release on both";
}

} // namespace bregma::dds
