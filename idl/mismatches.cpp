#include "idl/mismatches.hpp"

#include <map>
#include <mutex>
#include <set>

#include <dds/dds.h>

#include "idl/dds_process.hpp"

namespace bregma::dds {
namespace {

std::string policy_name(std::uint32_t policy) {
  switch (policy) {
  case DDS_DURABILITY_QOS_POLICY_ID:
    return "durability";
  case DDS_PRESENTATION_QOS_POLICY_ID:
    return "presentation";
  case DDS_DEADLINE_QOS_POLICY_ID:
    return "deadline";
  case DDS_LATENCYBUDGET_QOS_POLICY_ID:
    return "latency budget";
  case DDS_OWNERSHIP_QOS_POLICY_ID:
    return "ownership";
  case DDS_LIVELINESS_QOS_POLICY_ID:
    return "liveliness";
  case DDS_PARTITION_QOS_POLICY_ID:
    return "partition";
  case DDS_RELIABILITY_QOS_POLICY_ID:
    return "reliability";
  case DDS_DESTINATIONORDER_QOS_POLICY_ID:
    return "destination order";
  case DDS_TYPE_CONSISTENCY_ENFORCEMENT_QOS_POLICY_ID:
    return "type";
  case DDS_DATA_REPRESENTATION_QOS_POLICY_ID:
    return "data representation";
  default:
    return "policy " + std::to_string(policy);
  }
}

} // namespace

std::string Mismatch::text() const {
  if (policy == "type") {
    return topic + (writer ? ": a reader" : ": a writer") + " of another type is here";
  }
  return topic +
         (writer ? ": a reader requires more than this program offers ("
                 : ": a writer offers less than this program requires (") +
         policy + ")";
}

struct Mismatches::Table {
  struct Event {
    dds_entity_t endpoint;
    std::uint32_t policy;
    bool writer;
  };

  void add(const Event &event) {
    const std::lock_guard lock(mutex);
    if (const auto topic = topics_.find(event.endpoint); topic != topics_.end()) {
      add(event, topic->second);
    } else {
      unnamed_.push_back(event);
    }
  }

  void name(dds_entity_t endpoint, const char *topic) {
    const std::lock_guard lock(mutex);
    topics_[endpoint] = topic;
    for (const Event &event : unnamed_) {
      if (event.endpoint == endpoint) {
        add(event, topic);
      }
    }
    std::erase_if(unnamed_, [endpoint](const Event &event) { return event.endpoint == endpoint; });
  }

  mutable std::mutex mutex;
  std::set<Mismatch> found;

private:
  void add(const Event &event, const std::string &topic) {
    const Mismatch one{topic, policy_name(event.policy), event.writer};
    if (found.insert(one).second) {
      log(Severity::kWarning, one.text());
    }
  }

  std::map<dds_entity_t, std::string> topics_;
  std::vector<Event> unnamed_;
};

Mismatches::Mismatches(std::int32_t participant) : participant_(participant), table_(std::make_unique<Table>()) {
  // Called by Cyclone's threads, for every endpoint of the participant.
  const std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> listener(dds_create_listener(table_.get()),
                                                                                 &dds_delete_listener);
  dds_lset_offered_incompatible_qos(listener.get(),
                                    [](dds_entity_t writer, dds_offered_incompatible_qos_status_t status, void *table) {
                                      static_cast<Table *>(table)->add({writer, status.last_policy_id, true});
                                    });
  dds_lset_requested_incompatible_qos(
      listener.get(), [](dds_entity_t reader, dds_requested_incompatible_qos_status_t status, void *table) {
        static_cast<Table *>(table)->add({reader, status.last_policy_id, false});
      });
  if (const dds_return_t result = dds_set_listener(participant, listener.get()); result < 0) {
    throw Error(std::string("DDS: cannot follow the matches of endpoints: ") + dds_strretcode(result));
  }
}

// The participant may live longer; when this returns, no call is under way.
Mismatches::~Mismatches() { (void)dds_set_listener(participant_, nullptr); }

void Mismatches::name(std::int32_t endpoint, const char *topic) const { table_->name(endpoint, topic); }

std::vector<Mismatch> Mismatches::found() const {
  const std::lock_guard lock(table_->mutex);
  return {table_->found.begin(), table_->found.end()};
}

std::string Mismatches::text() const {
  std::string out;
  for (const Mismatch &one : found()) {
    out += (out.empty() ? "" : "; ") + one.text();
  }
  return out;
}

} // namespace bregma::dds
