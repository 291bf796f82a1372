// The topics of a stage. In bregmad they are implemented by DDS and the recorder (server/dds_topics.hpp), in tests and
// benchmarks by memory (tests/support/memory_topics.hpp).
//
// Threads: the main thread makes links and ports; then only the stage's thread uses them. Reading and writing never
// throw and never wait.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <type_traits>

#include "casefile/session_file/session_file.hpp"
#include "idl/dds.hpp"
#include "idl/topics.hpp"

namespace bregma::server {

// A topic without its type.
struct TopicInfo {
  const char *name;
  const dds_topic_descriptor_t *descriptor;
  wire::Qos qos;
  std::size_t bytes; // size of a sample
  bool plain;        // a sample contains no pointers
};

template <class T> [[nodiscard]] TopicInfo topic_info() {
  return {wire::Topic<T>::kName, &wire::Topic<T>::descriptor(), wire::Topic<T>::kQos, sizeof(T),
          casefile::kIsRecordable<T>};
}

class Source {
public:
  virtual ~Source() = default;
  // Up to Batch's capacity of samples, on loan until they are returned. utc_ns: time of the call.
  virtual void take(dds::untyped::Batch &batch) noexcept = 0;
  virtual void give_back(dds::untyped::Batch &batch, std::int64_t utc_ns) noexcept = 0;
  [[nodiscard]] virtual std::uint32_t writers_alive() noexcept = 0;
};

class Sink {
public:
  virtual ~Sink() = default;
  // DDS or the recorder counts a refused sample; the next one replaces it.
  virtual void write(const void *sample, std::int64_t utc_ns) noexcept = 0;
  // The last sample of its instance, which is then disposed.
  virtual void end(const void *last, std::int64_t utc_ns) noexcept = 0;
  [[nodiscard]] virtual std::uint32_t matched_readers() const noexcept = 0;
};

// The link of one stage to its topics.
class Link {
public:
  virtual ~Link() = default;
  // Throw dds::Error.
  [[nodiscard]] virtual std::unique_ptr<Source> source(const TopicInfo &topic) = 0;
  [[nodiscard]] virtual std::unique_ptr<Sink> sink(const TopicInfo &topic) = 0;
};

template <class T> class Subscriber {
public:
  explicit Subscriber(Link &link) : source_(link.source(topic_info<T>())) {}

  // Calls visit(const T &, std::uint64_t writer) for every sample since the last call, oldest first. A sample is valid
  // only during visit. A visit that returns false keeps the sample out of the recording. After max_batches the rest
  // waits for the next call, so that a flood does not keep the caller here. Returns the number of samples.
  template <class Visit>
  std::size_t take_each(std::int64_t utc_ns, Visit &&visit,
                        int max_batches = std::numeric_limits<int>::max()) noexcept {
    std::size_t total = 0;
    dds::untyped::Batch batch;
    do {
      source_->take(batch);
      for (int i = 0; i < batch.count; ++i) {
        if (batch.valid[i]) {
          const T &sample = *static_cast<const T *>(batch.samples[i]);
          if constexpr (std::is_same_v<std::invoke_result_t<Visit &, const T &, std::uint64_t>, bool>) {
            batch.valid[i] = visit(sample, batch.infos[i].writer);
          } else {
            visit(sample, batch.infos[i].writer);
          }
          ++total;
        }
      }
      source_->give_back(batch, utc_ns);
    } while (batch.count == static_cast<int>(dds::untyped::kBatch) && --max_batches > 0);
    return total;
  }
  // Also resets the status that wakes the stage for a missed deadline or a lost writer.
  [[nodiscard]] std::uint32_t writers_alive() noexcept { return source_->writers_alive(); }

private:
  std::unique_ptr<Source> source_;
};

template <class T> class Publisher {
public:
  explicit Publisher(Link &link) : sink_(link.sink(topic_info<T>())) {}
  // A sample whose field ended is set disposes of its instance.
  void operator()(const T &sample, std::int64_t utc_ns) noexcept {
    if constexpr (requires { sample.ended; }) {
      if (sample.ended) {
        sink_->end(&sample, utc_ns);
        return;
      }
    }
    sink_->write(&sample, utc_ns);
  }
  [[nodiscard]] std::uint32_t matched_readers() const noexcept { return sink_->matched_readers(); }

private:
  std::unique_ptr<Sink> sink_;
};

// Makes the link of each stage.
class Topics {
public:
  virtual ~Topics() = default;
  // stage: its name. The link is valid as long as the topics.
  [[nodiscard]] virtual Link &link(const char *stage) = 0;
};

} // namespace bregma::server
