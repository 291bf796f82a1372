// The stages' topics in bregmad: DDS, with the recorder beside it. Everything that a stage takes or publishes goes to
// its channel of the recorder, where it is plain bytes.
//
// The stages write their topics themselves: handing a sample to a publisher thread costs one more wake-up, which costs
// more than the write (docs/latency.md).
//
// Threads: made by the main thread; a link by its stage's. wake() by any.
#pragma once

#include <chrono>
#include <deque>
#include <memory>
#include <string>

#include "idl/dds.hpp"
#include "server/recording/recorder.hpp"
#include "server/stages/ports.hpp"

namespace bregma::server {

class DdsLink final : public Link {
public:
  DdsLink(const dds::Participant &participant, recording::Recorder &recorder, std::string stage);

  [[nodiscard]] std::unique_ptr<Source> source(const TopicInfo &topic) override;
  [[nodiscard]] std::unique_ptr<Sink> sink(const TopicInfo &topic) override;

  [[nodiscard]] const std::string &stage() const { return stage_; }
  // Sleeps until a sample arrives, a deadline is missed, a writer is lost, wake() is called or time runs out. True when
  // something happened.
  bool wait(std::chrono::nanoseconds timeout) const noexcept { return wait_.wait(timeout); }
  void wake() const noexcept { guard_.raise(); }

private:
  const dds::Participant &participant_;
  recording::Recorder &recorder_;
  std::string stage_;
  dds::Guard guard_;
  dds::WaitSet wait_;
};

class DdsTopics final : public Topics {
public:
  // Both outlive the topics.
  DdsTopics(const dds::Participant &participant, recording::Recorder &recorder)
      : participant_(participant), recorder_(recorder) {}
  [[nodiscard]] DdsLink &link(const char *stage) override;
  [[nodiscard]] const std::deque<DdsLink> &links() const { return links_; }

private:
  const dds::Participant &participant_;
  recording::Recorder &recorder_;
  std::deque<DdsLink> links_;
};

} // namespace bregma::server
