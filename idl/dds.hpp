// Owners of Cyclone's C entities. Nothing outside idl/ includes Cyclone's own API headers.
//
// Threads: a Participant may be used by any thread. A Writer or Reader may be used by one thread at a time.
// Errors: constructors throw dds::Error; write and take never throw and never block for longer than Cyclone's
// max_blocking_time (100 ms, and only for topics that keep all samples).
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "idl/dds_process.hpp"
#include "idl/mismatches.hpp"
#include "idl/topics.hpp"
#include "idl/version.hpp"

namespace bregma::dds {

// A Cyclone handle, deleted with its owner.
class Entity {
public:
  explicit Entity(std::int32_t handle = 0) noexcept : handle_(handle) {}
  Entity(Entity &&other) noexcept : handle_(std::exchange(other.handle_, 0)) {}
  Entity &operator=(Entity &&other) noexcept;
  Entity(const Entity &) = delete;
  Entity &operator=(const Entity &) = delete;
  ~Entity();
  [[nodiscard]] std::int32_t handle() const noexcept { return handle_; }

private:
  std::int32_t handle_;
};

// domain_id: 0 to 230; processes on different domains do not see each other. Cyclone's domain, with its threads and
// plug-ins, ends with the last of its participants: no entity may outlive main.
class Participant {
public:
  explicit Participant(std::uint32_t domain_id, Role role = Role::kClient);
  // announced: the participant's USER_DATA. Only tests announce another version than their own.
  Participant(std::uint32_t domain_id, const wire::Announcement &announced, Role role = Role::kClient);
  [[nodiscard]] std::int32_t handle() const noexcept { return entity_.handle(); }
  // Its writers and readers that found another end which they cannot exchange samples with.
  [[nodiscard]] const Mismatches &mismatches() const noexcept { return *mismatches_; }

private:
  std::shared_ptr<void> domain_; // before the entity, which ends first
  Entity entity_;
  std::unique_ptr<Mismatches> mismatches_;
};

// A participant's identity on the domain, the same on every topic.
using Guid = std::array<std::uint8_t, 16>;

struct SampleInfo {
  std::int64_t source_time_ns; // the writer's host clock
  std::uint64_t writer;        // differs between writers, so that a restarted driver is detected
  bool ended;                  // its instance is disposed: this is the last sample
};

struct ReaderStatus {
  std::uint32_t deadlines_missed; // in total
  std::uint32_t writers_alive;    // currently
  std::uint32_t writers_lost;     // in total: by end of the process or of its lease
};

// The same without the type of the topic: for Writer and Reader below, and for server/dds_topics.cpp.
namespace untyped {
[[nodiscard]] Entity make_writer(const Participant &participant, const dds_topic_descriptor_t &descriptor,
                                 const char *topic_name, const wire::Qos &qos);
[[nodiscard]] Entity make_reader(const Participant &participant, const dds_topic_descriptor_t &descriptor,
                                 const char *topic_name, const wire::Qos &qos);
[[nodiscard]] bool write(const Entity &writer, const void *sample) noexcept;
[[nodiscard]] bool end(const Entity &writer, const void *last) noexcept;
[[nodiscard]] std::uint32_t matched_readers(const Entity &writer) noexcept;
[[nodiscard]] std::uint32_t matched_writers(const Entity &reader) noexcept;
[[nodiscard]] ReaderStatus status(const Entity &reader) noexcept;
[[nodiscard]] std::optional<Guid> participant_of(const Entity &reader, std::uint64_t writer);
[[nodiscard]] bool has_reader_of(const Entity &writer, const Guid &participant);
[[nodiscard]] bool has_writer_of(const Entity &reader, const Guid &participant);

inline constexpr std::size_t kBatch = 16;
struct Batch { // samples on loan from Cyclone
  void *samples[kBatch] = {};
  SampleInfo infos[kBatch] = {};
  bool valid[kBatch] = {};
  int count = 0;
};
void take(const Entity &reader, Batch &batch) noexcept;
void give_back(const Entity &reader, Batch &batch) noexcept;
} // namespace untyped

template <class T> class Writer {
public:
  explicit Writer(const Participant &participant, const wire::Qos &qos = wire::Topic<T>::kQos)
      : entity_(untyped::make_writer(participant, wire::Topic<T>::descriptor(), wire::Topic<T>::kName, qos)) {}

  // Serialises and sends on the caller's thread. False if Cyclone refused the sample (a malformed one, or a full
  // keep-all cache). The caller counts refused samples.
  [[nodiscard]] bool write(const T &sample) const noexcept { return untyped::write(entity_, &sample); }
  // Writes the last sample of its instance and disposes of the instance. Matched readers receive it with
  // SampleInfo::ended; readers that join later receive nothing of the instance, until it is written again.
  [[nodiscard]] bool end(const T &last) const noexcept { return untyped::end(entity_, &last); }
  [[nodiscard]] std::uint32_t matched_readers() const noexcept { return untyped::matched_readers(entity_); }
  // Whether one of them belongs to this participant. Allocates.
  [[nodiscard]] bool has_reader_of(const Guid &participant) const {
    return untyped::has_reader_of(entity_, participant);
  }

private:
  Entity entity_;
};

template <class T> class Reader {
public:
  explicit Reader(const Participant &participant, const wire::Qos &qos = wire::Topic<T>::kQos)
      : entity_(untyped::make_reader(participant, wire::Topic<T>::descriptor(), wire::Topic<T>::kName, qos)) {}

  // Calls visit(const T &, const SampleInfo &) for every sample that has arrived since the last call, oldest first.
  // The samples are on loan and valid only during visit. Returns their number.
  template <class Visit> std::size_t take_each(Visit &&visit) {
    std::size_t total = 0;
    untyped::Batch batch;
    do {
      untyped::take(entity_, batch);
      for (int i = 0; i < batch.count; ++i) {
        if (batch.valid[i]) {
          visit(*static_cast<const T *>(batch.samples[i]), batch.infos[i]);
          ++total;
        }
      }
      untyped::give_back(entity_, batch);
    } while (batch.count == static_cast<int>(untyped::kBatch));
    return total;
  }

  [[nodiscard]] std::uint32_t matched_writers() const noexcept { return untyped::matched_writers(entity_); }
  // Also resets the state that wakes a WaitSet for a missed deadline or a lost writer.
  [[nodiscard]] ReaderStatus status() const noexcept { return untyped::status(entity_); }
  // The participant of a sample's writer (SampleInfo); empty once that writer has ended. Allocates.
  [[nodiscard]] std::optional<Guid> participant_of(std::uint64_t writer) const {
    return untyped::participant_of(entity_, writer);
  }
  // Whether one of the matched writers belongs to this participant. Allocates.
  [[nodiscard]] bool has_writer_of(const Guid &participant) const {
    return untyped::has_writer_of(entity_, participant);
  }
  [[nodiscard]] const Entity &entity() const noexcept { return entity_; }

private:
  Entity entity_;
};

// Lets another thread wake a WaitSet.
class Guard {
public:
  explicit Guard(const Participant &participant);
  void raise() const noexcept;
  void lower() const noexcept;
  [[nodiscard]] const Entity &entity() const noexcept { return entity_; }

private:
  Entity entity_;
};

// Sleeps until data arrive, a deadline is missed, a writer is lost, a guard is raised, or the timeout expires.
class WaitSet {
public:
  explicit WaitSet(const Participant &participant);
  template <class T> void attach(const Reader<T> &reader) { attach(reader.entity()); }
  void attach(const Entity &reader);
  void attach(const Guard &guard);
  // True after an event, false after the timeout. Negative timeouts return at once.
  bool wait(std::chrono::nanoseconds timeout) const noexcept;

private:
  Entity entity_;
};

} // namespace bregma::dds
