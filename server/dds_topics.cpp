#include "server/dds_topics.hpp"

#include <cstddef>
#include <span>
#include <utility>

namespace bregma::server {
namespace {

std::span<const std::byte> bytes_of(const void *sample, const TopicInfo &topic) {
  return {static_cast<const std::byte *>(sample), topic.bytes};
}

class DdsSource final : public Source {
public:
  DdsSource(dds::Entity reader, recording::Channel &channel, const TopicInfo &topic)
      : reader_(std::move(reader)), channel_(channel), topic_(topic) {}

  void take(dds::untyped::Batch &batch) noexcept override {
    dds::untyped::take(reader_, batch);
    if (batch.count <= 0) {
      (void)dds::untyped::status(reader_); // else the wait set would wake for the same event again and again
    }
  }

  // Recorded after the stage has processed them, so that its output does not wait for the copy.
  void give_back(dds::untyped::Batch &batch, std::int64_t utc_ns) noexcept override {
    for (int i = 0; topic_.plain && i < batch.count; ++i) {
      if (batch.valid[i]) {
        (void)channel_.push(topic_.name, utc_ns,
                            bytes_of(batch.samples[i], topic_)); // dropped records are counted by the channel
      }
    }
    dds::untyped::give_back(reader_, batch);
  }

  [[nodiscard]] std::uint32_t writers_alive() noexcept override { return dds::untyped::status(reader_).writers_alive; }

private:
  dds::Entity reader_;
  recording::Channel &channel_;
  TopicInfo topic_;
};

class DdsSink final : public Sink {
public:
  DdsSink(dds::Entity writer, recording::Channel &channel, const TopicInfo &topic)
      : writer_(std::move(writer)), channel_(channel), topic_(topic) {}

  void write(const void *sample, std::int64_t utc_ns) noexcept override {
    (void)dds::untyped::write(writer_, sample); // the next sample replaces one that DDS refused
    record(sample, utc_ns);
  }

  void end(const void *last, std::int64_t utc_ns) noexcept override {
    (void)dds::untyped::end(writer_, last);
    record(last, utc_ns);
  }

  [[nodiscard]] std::uint32_t matched_readers() const noexcept override {
    return dds::untyped::matched_readers(writer_);
  }

private:
  void record(const void *sample, std::int64_t utc_ns) noexcept {
    if (topic_.plain) {
      (void)channel_.push(topic_.name, utc_ns, bytes_of(sample, topic_)); // the channel counts dropped records
    }
  }

  dds::Entity writer_;
  recording::Channel &channel_;
  TopicInfo topic_;
};

} // namespace

DdsLink::DdsLink(const dds::Participant &participant, recording::Recorder &recorder, std::string stage)
    : participant_(participant), recorder_(recorder), stage_(std::move(stage)), guard_(participant),
      wait_(participant) {
  wait_.attach(guard_);
}

std::unique_ptr<Source> DdsLink::source(const TopicInfo &topic) {
  dds::Entity reader = dds::untyped::make_reader(participant_, *topic.descriptor, topic.name, topic.qos);
  wait_.attach(reader);
  return std::make_unique<DdsSource>(std::move(reader), recorder_.channel(stage_), topic);
}

std::unique_ptr<Sink> DdsLink::sink(const TopicInfo &topic) {
  return std::make_unique<DdsSink>(dds::untyped::make_writer(participant_, *topic.descriptor, topic.name, topic.qos),
                                   recorder_.channel(stage_), topic);
}

DdsLink &DdsTopics::link(const char *stage) { return links_.emplace_back(participant_, recorder_, stage); }

} // namespace bregma::server
