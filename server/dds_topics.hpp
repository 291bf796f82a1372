// The stages' topics in bregmad: DDS and the recorder. All samples that a stage takes or publishes are also pushed to
// its recorder channel, if their type is plain bytes.
//
// The stages write their topics themselves. A separate publisher thread would need another wake-up, which takes longer
// than the write (docs/latency.md).
//
// Threads: the main thread constructs the topics; each link is used by the thread of its stage; any thread may call
// wake().
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
  // Sleeps until a sample arrives, a deadline is missed, a writer is lost, wake() is called or the timeout expires.
  // Returns false after the timeout.
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
  // Both must outlive the topics.
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
