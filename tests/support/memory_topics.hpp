// The stages' topics in memory: what a stage publishes is kept until deliver(), which hands it to the stages that read
// the topic and to observers. So no step allocates because of its topics, and a run repeats byte for byte.
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
  // A published sample, known by its topic; gone when the observer returns.
  using Observer = std::function<void(const server::TopicInfo &, const void *sample)>;

  MemoryTopics();
  ~MemoryTopics() override;

  [[nodiscard]] server::Link &link(const char *stage) override;

  // Puts a sample from outside before every stage that reads its topic.
  template <class T> void put(const T &sample) { put(server::topic_info<T>(), &sample); }
  // Of every topic, in the order of publication.
  void observe(Observer observer) { observers_.push_back(std::move(observer)); }
  template <class T, class Visit> void observe(Visit visit) {
    observe([visit](const server::TopicInfo &topic, const void *sample) {
      if (topic.descriptor == &wire::Topic<T>::descriptor()) {
        visit(*static_cast<const T *>(sample));
      }
    });
  }
  // What was published since the last call.
  void deliver();
  // Whether samples wait for this stage.
  [[nodiscard]] bool waiting(const char *stage) const;

private:
  void put(const server::TopicInfo &topic, const void *sample);
  std::map<std::string, std::unique_ptr<MemoryLink>, std::less<>> links_;
  std::vector<Observer> observers_;
};

} // namespace bregma::test
