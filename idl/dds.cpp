#include "idl/dds.hpp"

#include <algorithm>
#include <cstring>
#include <memory>
#include <vector>

#include <ddsc/dds.h>

namespace bregma::dds {
namespace {

std::int32_t checked(std::int32_t result, const std::string &what) {
  if (result < 0) {
    throw Error("DDS: " + what + ": " + dds_strretcode(result));
  }
  return result;
}

using QosPtr = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;

QosPtr make_qos(const wire::Qos &qos) {
  QosPtr out(dds_create_qos(), &dds_delete_qos);
  // Loops write the topics that keep the last value: such a write never waits for a slow reader.
  dds_qset_reliability(out.get(), qos.reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       qos.depth > 0 ? 0 : DDS_MSECS(100));
  dds_qset_durability(out.get(), qos.transient_local ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  if (qos.depth > 0) {
    dds_qset_history(out.get(), DDS_HISTORY_KEEP_LAST, qos.depth);
  } else {
    dds_qset_history(out.get(), DDS_HISTORY_KEEP_ALL, DDS_LENGTH_UNLIMITED);
  }
  if (qos.transient_local) {
    // A reader that joins late receives this history, not that of dds_qset_history; its default is one sample.
    dds_qset_durability_service(out.get(), 0, DDS_HISTORY_KEEP_LAST, qos.depth, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  }
  if (qos.deadline_ns > 0) {
    dds_qset_deadline(out.get(), qos.deadline_ns);
  }
  if (qos.lease_ns > 0) {
    dds_qset_liveliness(out.get(), DDS_LIVELINESS_AUTOMATIC, qos.lease_ns);
  }
  // Several writers of one instance must not hide each other, and samples must remain valid after their writer ends.
  dds_qset_writer_data_lifecycle(out.get(), false);
  return out;
}

Entity make_topic(const Participant &participant, const dds_topic_descriptor_t &descriptor, const char *name) {
  return Entity(checked(dds_create_topic(participant.handle(), &descriptor, name, nullptr, nullptr),
                        std::string("cannot create topic ") + name));
}

} // namespace

Entity &Entity::operator=(Entity &&other) noexcept {
  if (this != &other) {
    if (handle_ > 0) {
      dds_delete(handle_);
    }
    handle_ = std::exchange(other.handle_, 0);
  }
  return *this;
}

Entity::~Entity() {
  if (handle_ > 0) {
    dds_delete(handle_);
  }
}

Participant::Participant(std::uint32_t domain_id, Role role) : Participant(domain_id, wire::own_announcement(), role) {}

Participant::Participant(std::uint32_t domain_id, const wire::Announcement &announced, Role role)
    : domain_(use_domain(domain_id, role)) {
  const QosPtr qos(dds_create_qos(), &dds_delete_qos);
  const std::string data = wire::to_user_data(announced);
  dds_qset_userdata(qos.get(), data.data(), data.size());
  entity_ = Entity(checked(dds_create_participant(domain_id, qos.get(), nullptr),
                           "cannot join domain " + std::to_string(domain_id)));
  mismatches_ = std::make_unique<Mismatches>(entity_.handle());
}

namespace untyped {

Entity make_writer(const Participant &participant, const dds_topic_descriptor_t &descriptor, const char *topic_name,
                   const wire::Qos &qos) {
  const Entity topic = make_topic(participant, descriptor, topic_name);
  Entity out(checked(dds_create_writer(participant.handle(), topic.handle(), make_qos(qos).get(), nullptr),
                     std::string("cannot write topic ") + topic_name));
  participant.mismatches().name(out.handle(), topic_name);
  return out;
}

Entity make_reader(const Participant &participant, const dds_topic_descriptor_t &descriptor, const char *topic_name,
                   const wire::Qos &qos) {
  const Entity topic = make_topic(participant, descriptor, topic_name);
  Entity out(checked(dds_create_reader(participant.handle(), topic.handle(), make_qos(qos).get(), nullptr),
                     std::string("cannot read topic ") + topic_name));
  participant.mismatches().name(out.handle(), topic_name);
  return out;
}

bool write(const Entity &writer, const void *sample) noexcept {
  return dds_write(writer.handle(), sample) == DDS_RETCODE_OK;
}

bool end(const Entity &writer, const void *last) noexcept {
  const bool written = dds_writedispose(writer.handle(), last) == DDS_RETCODE_OK;
  // Without this the writer would keep the last sample of every instance for readers that join late.
  return dds_unregister_instance(writer.handle(), last) == DDS_RETCODE_OK && written;
}

std::uint32_t matched_readers(const Entity &writer) noexcept {
  dds_publication_matched_status_t status{};
  return dds_get_publication_matched_status(writer.handle(), &status) == DDS_RETCODE_OK ? status.current_count : 0;
}

std::uint32_t matched_writers(const Entity &reader) noexcept {
  dds_subscription_matched_status_t status{};
  return dds_get_subscription_matched_status(reader.handle(), &status) == DDS_RETCODE_OK ? status.current_count : 0;
}

ReaderStatus status(const Entity &reader) noexcept {
  dds_requested_deadline_missed_status_t deadline{};
  dds_liveliness_changed_status_t liveliness{};
  dds_subscription_matched_status_t matched{};
  (void)dds_get_requested_deadline_missed_status(reader.handle(), &deadline);
  (void)dds_get_liveliness_changed_status(reader.handle(), &liveliness);
  (void)dds_get_subscription_matched_status(reader.handle(), &matched);
  const std::uint32_t unmatched = matched.total_count - matched.current_count;
  return {deadline.total_count, liveliness.alive_count, unmatched + liveliness.not_alive_count};
}

namespace {

// Takes what Cyclone says of a matched endpoint; null: it has ended.
std::optional<Guid> take_participant(dds_builtintopic_endpoint_t *endpoint) {
  if (endpoint == nullptr) {
    return std::nullopt;
  }
  Guid out;
  std::memcpy(out.data(), endpoint->participant_key.v, out.size());
  dds_builtintopic_free_endpoint(endpoint);
  return out;
}

// list: dds_get_matched_subscriptions or _publications of this entity; data: of one of those.
template <class List, class Data>
bool is_matched_with(const Entity &entity, const Guid &participant, List list, Data data) {
  const int count = list(entity.handle(), nullptr, 0);
  std::vector<dds_instance_handle_t> ends(static_cast<std::size_t>(std::max(count, 0)));
  const int known = std::min(list(entity.handle(), ends.data(), ends.size()), count);
  return std::any_of(ends.begin(), ends.begin() + std::max(known, 0), [&](dds_instance_handle_t end) {
    return take_participant(data(entity.handle(), end)) == participant;
  });
}

} // namespace

std::optional<Guid> participant_of(const Entity &reader, std::uint64_t writer) {
  return take_participant(dds_get_matched_publication_data(reader.handle(), writer));
}

bool has_reader_of(const Entity &writer, const Guid &participant) {
  return is_matched_with(writer, participant, dds_get_matched_subscriptions, dds_get_matched_subscription_data);
}

bool has_writer_of(const Entity &reader, const Guid &participant) {
  return is_matched_with(reader, participant, dds_get_matched_publications, dds_get_matched_publication_data);
}

void take(const Entity &reader, Batch &batch) noexcept {
  dds_sample_info_t infos[kBatch];
  batch.samples[0] = nullptr; // requests a loan
  batch.count = dds_take(reader.handle(), batch.samples, infos, kBatch, kBatch);
  for (int i = 0; i < batch.count; ++i) {
    batch.infos[i] = {infos[i].source_timestamp, infos[i].publication_handle,
                      infos[i].instance_state == DDS_IST_NOT_ALIVE_DISPOSED};
    batch.valid[i] = infos[i].valid_data;
  }
}

void give_back(const Entity &reader, Batch &batch) noexcept {
  if (batch.count > 0) {
    (void)dds_return_loan(reader.handle(), batch.samples, batch.count);
  }
}

} // namespace untyped

Guard::Guard(const Participant &participant)
    : entity_(checked(dds_create_guardcondition(participant.handle()), "cannot create a guard condition")) {}

void Guard::raise() const noexcept { (void)dds_set_guardcondition(entity_.handle(), true); }
void Guard::lower() const noexcept { (void)dds_set_guardcondition(entity_.handle(), false); }

WaitSet::WaitSet(const Participant &participant)
    : entity_(checked(dds_create_waitset(participant.handle()), "cannot create a wait set")) {}

void WaitSet::attach(const Guard &guard) {
  checked(dds_waitset_attach(entity_.handle(), guard.entity().handle(), 0), "cannot wait for a guard");
}

void WaitSet::attach(const Entity &reader) {
  checked(dds_set_status_mask(reader.handle(), DDS_DATA_AVAILABLE_STATUS | DDS_REQUESTED_DEADLINE_MISSED_STATUS |
                                                   DDS_LIVELINESS_CHANGED_STATUS),
          "cannot choose what to wait for");
  checked(dds_waitset_attach(entity_.handle(), reader.handle(), 0), "cannot wait for a reader");
}

bool WaitSet::wait(std::chrono::nanoseconds timeout) const noexcept {
  return dds_waitset_wait(entity_.handle(), nullptr, 0, timeout.count() > 0 ? timeout.count() : 0) > 0;
}

} // namespace bregma::dds
