#include "tests/support/memory_topics.hpp"

#include <algorithm>
#include <string_view>

namespace bregma::test {
namespace {

using server::TopicInfo;

constexpr std::size_t kReserved = 64; // samples per topic between two deliveries without an allocation
using Writers = std::map<const dds_topic_descriptor_t *, std::uint32_t>;

// Samples that wait for a stage, and those that it has on loan.
struct Queue {
  struct Sample {
    std::vector<std::byte> bytes;
    std::uint64_t writer;
  };
  TopicInfo topic;
  std::deque<Sample> samples;
};

// Samples of a plain topic published by a stage since the last delivery.
struct Outgoing {
  TopicInfo topic;
  std::vector<std::byte> bytes; // concatenated samples
  std::vector<bool> ended;      // per sample: it is the last one of its instance
};

class MemorySource final : public server::Source {
public:
  MemorySource(Queue &queue, const Writers &writers) : queue_(queue), writers_(writers) {}
  void take(dds::untyped::Batch &batch) noexcept override {
    batch.count = static_cast<int>(std::min(queue_.samples.size(), dds::untyped::kBatch));
    for (int i = 0; i < batch.count; ++i) {
      Queue::Sample &sample = queue_.samples[static_cast<std::size_t>(i)];
      batch.samples[i] = sample.bytes.data();
      batch.infos[i] = {0, sample.writer, false};
      batch.valid[i] = true;
    }
  }
  void give_back(dds::untyped::Batch &batch, std::int64_t /*utc_ns*/) noexcept override {
    queue_.samples.erase(queue_.samples.begin(), queue_.samples.begin() + batch.count);
  }
  [[nodiscard]] std::uint32_t writers_alive() noexcept override {
    const auto found = writers_.find(queue_.topic.descriptor);
    return found == writers_.end() ? 1 : found->second;
  }

private:
  Queue &queue_;
  const Writers &writers_;
};

class MemorySink final : public server::Sink {
public:
  MemorySink(Outgoing &outgoing, const MemoryTopics &topics) : outgoing_(outgoing), topics_(topics) {}
  void write(const void *sample, std::int64_t /*utc_ns*/) noexcept override { add(sample, false); }
  void end(const void *last, std::int64_t /*utc_ns*/) noexcept override { add(last, true); }
  [[nodiscard]] std::uint32_t matched_readers() const noexcept override { return 1; }

private:
  void add(const void *sample, bool last) noexcept {
    if (!outgoing_.topic.plain) {
      topics_.show(outgoing_.topic, sample, last);
      return;
    }
    const auto *bytes = static_cast<const std::byte *>(sample);
    outgoing_.bytes.insert(outgoing_.bytes.end(), bytes, bytes + outgoing_.topic.bytes);
    outgoing_.ended.push_back(last);
  }

  Outgoing &outgoing_;
  const MemoryTopics &topics_;
};

} // namespace

class MemoryLink final : public server::Link {
public:
  MemoryLink(const Writers &writers, const MemoryTopics &topics) : writers_(writers), topics_(topics) {}
  [[nodiscard]] std::unique_ptr<server::Source> source(const TopicInfo &topic) override {
    return std::make_unique<MemorySource>(incoming.emplace_back(Queue{topic, {}}), writers_);
  }
  [[nodiscard]] std::unique_ptr<server::Sink> sink(const TopicInfo &topic) override {
    Outgoing &one = outgoing.emplace_back(Outgoing{topic, {}, {}});
    one.bytes.reserve(kReserved * topic.bytes);
    one.ended.reserve(kReserved);
    return std::make_unique<MemorySink>(one, topics_);
  }

  std::deque<Queue> incoming; // the ends hold references
  std::deque<Outgoing> outgoing;

private:
  const Writers &writers_;
  const MemoryTopics &topics_;
};

MemoryTopics::MemoryTopics() = default;
MemoryTopics::~MemoryTopics() = default;

void MemoryTopics::disconnect() { links_.clear(); }

server::Link &MemoryTopics::link(const char *stage) {
  return *links_.emplace(stage, std::make_unique<MemoryLink>(writers_, *this)).first->second;
}

void MemoryTopics::put(const TopicInfo &topic, const void *sample, std::uint64_t writer) {
  const auto *bytes = static_cast<const std::byte *>(sample);
  for (const auto &[stage, link] : links_) {
    for (Queue &queue : link->incoming) {
      if (queue.topic.descriptor == topic.descriptor) {
        queue.samples.push_back({{bytes, bytes + topic.bytes}, writer});
      }
    }
  }
}

void MemoryTopics::deliver() {
  for (const auto &[stage, link] : links_) {
    for (Outgoing &outgoing : link->outgoing) {
      for (std::size_t i = 0; i < outgoing.ended.size(); ++i) {
        const std::byte *sample = outgoing.bytes.data() + i * outgoing.topic.bytes;
        put(outgoing.topic, sample, kWriter);
        show(outgoing.topic, sample, outgoing.ended[i]);
      }
      outgoing.bytes.clear();
      outgoing.ended.clear();
    }
  }
}

void MemoryTopics::show(const TopicInfo &topic, const void *sample, bool last) const {
  for (const Observer &observer : observers_) {
    observer(topic, sample);
  }
  if (last) {
    for (const Observer &observer : end_observers_) {
      observer(topic, sample);
    }
  }
}

bool MemoryTopics::waiting(const char *stage) const {
  const auto found = links_.find(std::string_view(stage));
  return found != links_.end() && std::any_of(found->second->incoming.begin(), found->second->incoming.end(),
                                              [](const Queue &queue) { return !queue.samples.empty(); });
}

} // namespace bregma::test
