// The stages' topics in memory. Published samples are kept until deliver(), which passes them to the reading stages and
// to observers. So topics cause no allocation in a step, and runs are reproducible byte for byte. A sample with
// sequences is valid only while it is written, so observers see it at once; no stage reads such a topic in memory.
//
// One thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/stages/ports.hpp"

namespace bregma::test {

class MemoryLink;

class MemoryTopics final : public server::Topics {
public:
  // A published sample and its topic; valid during the call of the observer.
  using Observer = std::function<void(const server::TopicInfo &, const void *sample)>;

  static constexpr std::uint64_t kWriter = 1;

  MemoryTopics();
  ~MemoryTopics() override;

  [[nodiscard]] server::Link &link(const char *stage) override;

  // Passes an external sample to every stage that reads its topic. writer: identity of the process that wrote it.
  template <class T> void put(const T &sample, std::uint64_t writer = kWriter) {
    put(server::topic_info<T>(), &sample, writer);
  }
  // Number of external writers of T that are alive; 1 at first.
  template <class T> void set_writers_alive(std::uint32_t count) { writers_[&wire::Topic<T>::descriptor()] = count; }
  // The stages have ended: their ends of the topics are void. Observers stay.
  void disconnect();
  // For all topics, in the order of publication.
  void observe(Observer observer) { observers_.push_back(std::move(observer)); }
  template <class T, class Visit> void observe(Visit visit) {
    observe([visit](const server::TopicInfo &topic, const void *sample) {
      if (topic.descriptor == &wire::Topic<T>::descriptor()) {
        visit(*static_cast<const T *>(sample));
      }
    });
  }
  // For the last sample of each instance that a stage ends; called after the observers of all samples.
  void observe_ends(Observer observer) { end_observers_.push_back(std::move(observer)); }
  // Samples published since the last call.
  void deliver();
  // To the observers. last: the instance has ended.
  void show(const server::TopicInfo &topic, const void *sample, bool last) const;
  // Whether samples wait for this stage.
  [[nodiscard]] bool waiting(const char *stage) const;

private:
  void put(const server::TopicInfo &topic, const void *sample, std::uint64_t writer);
  std::map<const dds_topic_descriptor_t *, std::uint32_t> writers_; // where the number is not 1
  std::map<std::string, std::unique_ptr<MemoryLink>, std::less<>> links_;
  std::vector<Observer> observers_;
  std::vector<Observer> end_observers_;
};

} // namespace bregma::test
