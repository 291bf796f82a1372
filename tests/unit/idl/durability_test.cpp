// What a reader that joins late receives on every topic of the table, and what is left of an instance that has ended.
// Writer and reader are two domains of this process on one network, so that the samples cross a socket.
#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <unistd.h>

#include "idl/dds.hpp"
#include "idl/names.hpp"

namespace {

using namespace bregma;
using namespace std::chrono_literals;

constexpr std::chrono::seconds kPatience = 20s; // only limits a hang

struct TwoDomains {
  std::uint32_t writer = 200 + static_cast<std::uint32_t>(getpid()) % 15;
  std::uint32_t reader = writer + 15;
};

// Cyclone counts the reader's domain as the writer's on the network. Set before the process joins either.
TwoDomains two_domains() {
  static const TwoDomains domains = [] {
    const TwoDomains out;
    const std::string bridge = "<CycloneDDS><Domain Id=\"" + std::to_string(out.reader) +
                               "\"><Discovery><ExternalDomainId>" + std::to_string(out.writer) +
                               "</ExternalDomainId></Discovery></Domain></CycloneDDS>";
    setenv("CYCLONEDDS_URI", (std::string(dds::default_configuration()) + "," + bridge).c_str(), 1);
    return out;
  }();
  return domains;
}

template <class T> bool wait_for_match(const dds::Writer<T> &writer, const dds::Reader<T> &reader) {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (writer.matched_readers() == 0 || reader.matched_writers() == 0) {
    if (std::chrono::steady_clock::now() > end) {
      return false;
    }
    std::this_thread::sleep_for(2ms);
  }
  return true;
}

// Takes until this number of samples has arrived; returns the number that has.
template <class T, class Visit> std::size_t take(dds::Reader<T> &reader, std::size_t wanted, Visit &&visit) {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  std::size_t taken = reader.take_each(visit);
  while (taken < wanted && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(2ms);
    taken += reader.take_each(visit);
  }
  return taken;
}

template <class T> void expect_history_of_the_table() {
  SCOPED_TRACE(wire::Topic<T>::kName);
  constexpr wire::Qos kQos = wire::Topic<T>::kQos;
  constexpr std::size_t kHistory = kQos.transient_local ? kQos.depth : 0;
  const dds::Participant out(two_domains().writer);
  const dds::Writer<T> writer(out);
  const T sample{};
  for (std::size_t i = 0; i < kHistory + 3; ++i) {
    ASSERT_TRUE(writer.write(sample));
  }
  const dds::Participant in(two_domains().reader);
  dds::Reader<T> late(in);
  ASSERT_TRUE(wait_for_match(writer, late));
  EXPECT_EQ(take(late, kHistory, [](const T &, const auto &) {}), kHistory);
  ASSERT_TRUE(writer.write(sample));
  EXPECT_EQ(take(late, 1, [](const T &, const auto &) {}), 1U) << "no more than the new one";
}

TEST(Durability, ALateReaderReceivesTheHistoryOfTheTableOnEveryTopic) {
#define BREGMA_CHECK(Type, qos) expect_history_of_the_table<wire::Type>();
  BREGMA_TOPICS(BREGMA_CHECK)
#undef BREGMA_CHECK
}

TEST(Durability, ALateDisplayReceivesTheWholeTraceInItsOrder) {
  constexpr std::size_t kPoints = 334;
  const dds::Participant out(two_domains().writer);
  const dds::Writer<wire::CapturedPoint> writer(out);
  wire::CapturedPoint point{};
  ASSERT_TRUE(wire::set_name(point.tool, "Stylus"));
  for (point.frame = 1; point.frame <= kPoints; ++point.frame) {
    ASSERT_TRUE(writer.write(point));
  }
  const dds::Participant in(two_domains().reader);
  dds::Reader<wire::CapturedPoint> late(in);
  std::vector<std::uint64_t> frames;
  EXPECT_EQ(take(late, kPoints, [&](const auto &sample, const auto &) { frames.push_back(sample.frame); }), kPoints);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    ASSERT_EQ(frames[i], i + 1);
  }
}

// Every type of state begins with the name that tells its instances apart.
template <class T> wire::Name &name_of(T &sample) {
  if constexpr (requires { sample.tool; }) {
    return sample.tool;
  } else if constexpr (requires { sample.reference; }) {
    return sample.reference;
  } else if constexpr (requires { sample.model; }) {
    return sample.model;
  } else if constexpr (requires { sample.state; }) {
    return sample.kind; // Alarm
  } else {
    return sample.point;
  }
}

template <class T> T named(const char *name) {
  T out{};
  EXPECT_TRUE(wire::set_name(name_of(out), name));
  return out;
}

// The samples of the instance "case" that a reader receives which joins now.
template <class T> std::vector<T> received_late(const dds::Writer<T> &writer) {
  const dds::Participant in(two_domains().reader);
  dds::Reader<T> late(in);
  std::vector<T> out;
  bool end = false;
  EXPECT_TRUE(wait_for_match(writer, late));
  EXPECT_TRUE(writer.write(named<T>("marker"))); // after the history
  const auto limit = std::chrono::steady_clock::now() + kPatience;
  while (!end && std::chrono::steady_clock::now() < limit) {
    std::this_thread::sleep_for(2ms);
    late.take_each([&](T sample, const auto &) {
      end = end || wire::view(name_of(sample)) == "marker";
      if (wire::view(name_of(sample)) == "case") {
        out.push_back(sample);
      }
    });
  }
  EXPECT_TRUE(end);
  return out;
}

template <class T> void expect_nothing_left_of_an_ended_instance() {
  SCOPED_TRACE(wire::Topic<T>::kName);
  const dds::Participant out(two_domains().writer);
  const dds::Participant in(two_domains().reader);
  const dds::Writer<T> writer(out);
  dds::Reader<T> early(in);
  ASSERT_TRUE(wait_for_match(writer, early));
  T sample = named<T>("case");
  ASSERT_TRUE(writer.write(sample));
  ASSERT_EQ(take(early, 1, [](const T &one, const dds::SampleInfo &info) { EXPECT_FALSE(one.ended || info.ended); }),
            1U);
  EXPECT_EQ(received_late(writer).size(), 1U);

  sample.ended = true;
  ASSERT_TRUE(writer.end(sample));
  bool ended = false;
  (void)take(early, 2, [&](const T &one, const dds::SampleInfo &info) { ended = ended || (one.ended && info.ended); });
  EXPECT_TRUE(ended) << "the last sample says so in the data and in its state";
  // The writer keeps the last sample until every matched reader has acknowledged it.
  std::vector<T> left = received_late(writer);
  const auto limit = std::chrono::steady_clock::now() + kPatience;
  while (!left.empty() && std::chrono::steady_clock::now() < limit) {
    EXPECT_TRUE(left.back().ended);
    left = received_late(writer);
  }
  EXPECT_TRUE(left.empty());

  sample.ended = false;
  ASSERT_TRUE(writer.write(sample)) << "the next case has an instance of the same name";
  left = received_late(writer);
  ASSERT_EQ(left.size(), 1U);
  EXPECT_FALSE(left.front().ended);
}

TEST(Durability, AnInstanceThatHasEndedIsNotReceivedByALateReaderAndMayBeginAgain) {
  expect_nothing_left_of_an_ended_instance<wire::NavigationState>();
  expect_nothing_left_of_an_ended_instance<wire::RegistrationState>();
  expect_nothing_left_of_an_ended_instance<wire::AccuracyState>();
  expect_nothing_left_of_an_ended_instance<wire::FiducialReport>();
  expect_nothing_left_of_an_ended_instance<wire::CapturedPoint>();
  expect_nothing_left_of_an_ended_instance<wire::DeformationState>();
  expect_nothing_left_of_an_ended_instance<wire::DeformationField>();
  expect_nothing_left_of_an_ended_instance<wire::Alarm>();
}

} // namespace
