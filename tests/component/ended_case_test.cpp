// What is left on the topics after a case was closed: every instance of the case got a last sample and was disposed.
#include <cmath>
#include <map>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "server/stages/tissue_model/stage.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

// Topic and name of every instance, and whether it has ended.
using Instances = std::map<std::pair<std::string, std::string>, bool>;

// Instances of the types that belong to a case, and of alarms, as a client sees them.
class Bus {
public:
  explicit Bus(MemoryTopics &topics) {
    follow<wire::NavigationState>(topics, [](const auto &sample) { return wire::text(sample.tool); });
    follow<wire::RegistrationState>(topics, [](const auto &sample) { return wire::text(sample.reference); });
    follow<wire::FiducialReport>(topics, [](const auto &sample) { return wire::text(sample.reference); });
    follow<wire::AccuracyState>(topics, [](const auto &sample) { return wire::text(sample.reference); });
    follow<wire::CapturedPoint>(topics, [](const auto &sample) { return wire::text(sample.tool); });
    follow<wire::DeformationState>(topics, [](const auto &sample) { return wire::text(sample.point); });
    follow<wire::DeformationField>(topics, [](const auto &sample) { return wire::text(sample.model); });
    follow<wire::Alarm>(topics, [](const auto &sample) { return wire::text(sample.kind); });
    topics.observe_ends([this](const server::TopicInfo &topic, const void * /*last*/) { ++disposed_[topic.name]; });
  }

  [[nodiscard]] const Instances &instances() const { return instances_; }
  [[nodiscard]] std::size_t alive(const std::string &topic) const {
    std::size_t out = 0;
    for (const auto &[key, ended] : instances_) {
      out += key.first == topic && !ended ? 1 : 0;
    }
    return out;
  }
  [[nodiscard]] int ended_samples(const std::string &topic) { return ended_[topic]; }
  [[nodiscard]] int disposed(const std::string &topic) { return disposed_[topic]; }

private:
  template <class T, class Name> void follow(MemoryTopics &topics, Name name) {
    topics.observe<T>([this, name](const T &sample) {
      instances_[{wire::Topic<T>::kName, name(sample)}] = sample.ended;
      ended_[wire::Topic<T>::kName] += sample.ended ? 1 : 0;
    });
  }

  Instances instances_;
  std::map<std::string, int> ended_, disposed_;
};

const std::string kWait = "[[steps]]\ndo = \"wait\"\nduration_s = 3.0\n";
constexpr const char *kCaseTopics[] = {"NavigationState", "FiducialReport", "CapturedPoint", "DeformationState",
                                       "DeformationField"};

TEST(EndedCase, LeavesNothingOnTheTopicsThatAClientThatJoinsLateCouldTakeForThePresent) {
  const CaseFolder folder;
  const std::string end = "[[steps]]\ndo = \"stop_navigation\"\n[[steps]]\ndo = \"close_case\"\n" + kWait;
  server::Config config = quick_config();
  config.stages.of<server::TissueModelParameters>().elements = 2000;
  VirtualOperation operation(folder.loaded(), scenario_of(kRegisterSteps + kNavigateSteps + end), kSeed, config);
  Bus bus(operation.topics());
  wire::NavigationState last{};
  operation.topics().observe<wire::NavigationState>([&](const wire::NavigationState &state) {
    last = state;
    if (state.ended) {
      EXPECT_EQ(state.status, bregma_wire_POSE_NOT_REGISTERED);
      EXPECT_TRUE(std::isnan(state.T_image_tip.translation_mm[0]));
      EXPECT_TRUE(std::isnan(state.tre_rms_mm));
    }
  });
  operation.topics().observe<wire::RegistrationState>([&](const wire::RegistrationState &state) {
    if (state.ended) {
      EXPECT_EQ(state.status, bregma_wire_REGISTRATION_NONE);
      EXPECT_EQ(state.accepted_revision, 0U);
      EXPECT_TRUE(std::isnan(state.accepted_T_image_reference.translation_mm[0]));
    }
  });
  ASSERT_TRUE(operation.run()) << operation.failure();
  ASSERT_EQ(operation.session().state(), bregma_wire_SESSION_IDLE);

  EXPECT_TRUE(last.ended);
  for (const char *topic : kCaseTopics) {
    EXPECT_GT(bus.ended_samples(topic), 0) << topic;
    EXPECT_EQ(bus.alive(topic), 0U) << topic;
  }
  EXPECT_EQ(bus.alive("Alarm"), 0U);
  // Without a case these have one instance, which has no name and states that there is none.
  for (const char *topic : {"RegistrationState", "AccuracyState"}) {
    EXPECT_EQ(bus.alive(topic), 1U) << topic;
    EXPECT_FALSE(bus.instances().at({topic, ""})) << topic;
    EXPECT_TRUE(bus.instances().at({topic, "Reference"})) << topic;
  }
  for (const auto &[key, ended] : bus.instances()) {
    EXPECT_EQ(bus.disposed(key.first), bus.ended_samples(key.first)) << key.first;
  }
}

TEST(EndedCase, ARegistrationThatIsStartedAnewEndsThePointsOfTheLastOne) {
  const CaseFolder folder;
  VirtualOperation operation(folder.loaded(),
                             scenario_of(kRegisterSteps + "[[steps]]\ndo = \"start_registration\"\n" + kWait), kSeed);
  Bus bus(operation.topics());
  ASSERT_TRUE(operation.run()) << operation.failure();
  EXPECT_EQ(bus.alive("CapturedPoint"), 0U);
  EXPECT_EQ(bus.ended_samples("CapturedPoint"), 1) << "of the stylus";
  EXPECT_EQ(operation.fiducials().count, 0U);
}

} // namespace
} // namespace bregma::test
