// Reproducibility in virtual time: the same case, scenario and seed publish the same bytes on every topic.
#include <cstddef>
#include <cstring>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "server/stages/tissue_model/stage.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

struct Published {
  std::string topic;
  std::vector<std::byte> bytes;
  bool operator==(const Published &) const = default;
};

// The only fields that depend on the processor and not on the operation.
void mask_wall_time(wire::RegistrationState &state) { state.duration_ms = 0.0; }
void mask_wall_time(wire::SystemHealth &health) {
  health.resident_bytes = 0;
  health.loop_count = 0;
  std::memset(health.loops, 0, sizeof health.loops);
}

template <class T> void copy_masked(const void *sample, std::vector<std::byte> &out) {
  T copy;
  std::memcpy(&copy, sample, sizeof copy);
  mask_wall_time(copy);
  const auto *bytes = reinterpret_cast<const std::byte *>(&copy);
  out.assign(bytes, bytes + sizeof copy);
}

Published published(const server::TopicInfo &topic, const void *sample) {
  Published out{topic.name, {}};
  if (out.topic == wire::Topic<wire::RegistrationState>::kName) {
    copy_masked<wire::RegistrationState>(sample, out.bytes);
  } else if (out.topic == wire::Topic<wire::SystemHealth>::kName) {
    copy_masked<wire::SystemHealth>(sample, out.bytes);
  } else if (out.topic == wire::Topic<wire::DeformationField>::kName) {
    const auto &field = *static_cast<const wire::DeformationField *>(sample);
    for (const auto *values : {&field.displacement_mm, &field.von_mises_Pa}) {
      const auto *bytes = reinterpret_cast<const std::byte *>(values->_buffer);
      out.bytes.insert(out.bytes.end(), bytes, bytes + values->_length * sizeof(float));
    }
  } else {
    const auto *bytes = static_cast<const std::byte *>(sample);
    out.bytes.assign(bytes, bytes + topic.bytes);
  }
  return out;
}

std::vector<Published> operate(const CaseFolder &folder, const std::string &steps, const server::Config &config) {
  VirtualOperation operation(folder.loaded(), scenario_of(steps), kSeed, config);
  std::vector<Published> out;
  operation.topics().observe(
      [&out](const server::TopicInfo &topic, const void *sample) { out.push_back(published(topic, sample)); });
  EXPECT_TRUE(operation.run()) << operation.failure();
  return out;
}

void expect_same(const std::vector<Published> &first, const std::vector<Published> &second) {
  ASSERT_EQ(first.size(), second.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    ASSERT_EQ(first[i].topic, second[i].topic) << "sample " << i;
    ASSERT_EQ(first[i].bytes, second[i].bytes) << first[i].topic << ", sample " << i;
  }
}

TEST(VirtualTime, AnOperationPublishesTheSameBytesTwice) {
  const CaseFolder folder;
  const std::string steps = kRegisterSteps + kNavigateSteps;
  const auto first = operate(folder, steps, quick_config());
  EXPECT_GT(first.size(), 10'000U);
  expect_same(first, operate(folder, steps, quick_config()));
}

TEST(VirtualTime, AnOperationWithTheTissueModelPublishesTheSameBytesTwice) {
  const CaseFolder folder;
  const std::string steps = kRegisterSteps + kNavigateSteps;
  server::Config config = quick_config();
  config.stages.of<server::TissueModelParameters>().elements = 2000;
  const auto first = operate(folder, steps, config);
  std::size_t fields = 0;
  for (const Published &one : first) {
    fields += one.topic == wire::Topic<wire::DeformationField>::kName ? 1 : 0;
  }
  EXPECT_GT(fields, 100U);
  expect_same(first, operate(folder, steps, config));
}

} // namespace
} // namespace bregma::test
