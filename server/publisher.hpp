// Publishes a topic and records what was published. One thread each; a write never waits (idl/topics.hpp).
#pragma once

#include <cstdint>

#include "idl/dds.hpp"
#include "server/recording/recorder.hpp"

namespace bregma::server {

template <class T> class Publisher {
public:
  Publisher(const dds::Participant &participant, recording::Channel &channel)
      : writer_(participant), channel_(channel) {}

  // A sample that DDS or the recorder's ring did not take is counted by them (a sample that DDS refuses is a sample
  // that the next one replaces).
  void operator()(const T &sample, std::int64_t now_ns) noexcept {
    (void)writer_.write(sample);
    (void)channel_.push(now_ns, sample);
  }

private:
  dds::Writer<T> writer_;
  recording::Channel &channel_;
};

} // namespace bregma::server
