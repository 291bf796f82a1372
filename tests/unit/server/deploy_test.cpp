// Cyclone accepts the supplied configurations, and samples are transferred with them.
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "idl/dds.hpp"
#include "idl/names.hpp"

namespace bregma {
namespace {

using namespace std::chrono_literals;

// As much as DDS wants, or as this machine allows.
std::size_t expected_send_buffer() {
  std::size_t most = 0;
  std::ifstream("/proc/sys/net/core/wmem_max") >> most;
  return std::min(most, dds::kSendBufferBytes);
}

// The participant throws if Cyclone does not know a setting.
bool sample_passes(const char *file, std::uint32_t domain) {
  const std::filesystem::path path = std::filesystem::path(BREGMA_SOURCE_DIR) / "deploy" / file;
  std::ifstream stream(path);
  std::string configuration{std::istreambuf_iterator<char>(stream), {}};
  EXPECT_FALSE(configuration.empty()) << path;
  const std::string any = "autodetermine=\"true\""; // restricts the test to this machine
  if (const auto at = configuration.find(any); at != std::string::npos) {
    configuration.replace(at, any.size(), "name=\"lo\"");
  }
  ::setenv("CYCLONEDDS_URI", configuration.c_str(), 1);
  const dds::Participant writing(domain);
  const dds::Participant reading(domain);
  EXPECT_EQ(dds::send_buffer_bytes(), expected_send_buffer()) << file;
  const dds::Writer<wire::Alarm> writer(writing);
  dds::Reader<wire::Alarm> reader(reading);
  wire::Alarm alarm{};
  EXPECT_TRUE(wire::set_name(alarm.kind, "drift"));
  EXPECT_TRUE(writer.write(alarm));
  for (int i = 0; i < 500; ++i) { // transient local: the sample may arrive late
    bool arrived = false;
    reader.take_each([&](const wire::Alarm &taken, const auto &) { arrived |= wire::view(taken.kind) == "drift"; });
    if (arrived) {
      return true;
    }
    std::this_thread::sleep_for(10ms);
  }
  return false;
}

TEST(Deploy, CycloneAcceptsTheConfigurationForOneMachine) { EXPECT_TRUE(sample_passes("cyclonedds-local.xml", 201)); }
TEST(Deploy, CycloneAcceptsTheConfigurationForANetwork) { EXPECT_TRUE(sample_passes("cyclonedds-network.xml", 202)); }

} // namespace
} // namespace bregma
