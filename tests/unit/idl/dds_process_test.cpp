// What the participants of a process have in common: configuration, log, sockets, and mismatches with others.
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "idl/dds.hpp"
#include "idl/names.hpp"

namespace {

using namespace bregma;
using namespace std::chrono_literals;

std::uint32_t test_domain() { return 100 + static_cast<std::uint32_t>(getpid()) % 100; }

template <class Done> bool eventually(Done &&done) {
  for (int i = 0; i < 1000 && !done(); ++i) { // only limits a hang
    std::this_thread::sleep_for(10ms);
  }
  return done();
}

class Lines {
public:
  Lines() {
    dds::set_log([this](dds::Severity, std::string_view line) {
      const std::lock_guard lock(mutex_);
      lines_.emplace_back(line);
    });
  }
  ~Lines() {
    dds::set_log([](dds::Severity, std::string_view) {});
  }
  [[nodiscard]] std::size_t count(const std::string &part) const {
    const std::lock_guard lock(mutex_);
    return static_cast<std::size_t>(std::count_if(
        lines_.begin(), lines_.end(), [&](const auto &line) { return line.find(part) != std::string::npos; }));
  }

private:
  mutable std::mutex mutex_;
  std::vector<std::string> lines_;
};

TEST(DdsProcess, AConfigurationWithoutASendBufferGetsOne) {
  setenv("CYCLONEDDS_URI",
         "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\"/></Interfaces></General></Domain>"
         "</CycloneDDS>",
         1);
  std::size_t most = 0;
  std::ifstream("/proc/sys/net/core/wmem_max") >> most;
  {
    const dds::Participant participant(test_domain());
    EXPECT_EQ(dds::send_buffer_bytes(), std::min(most, dds::kSendBufferBytes));
  }
  EXPECT_EQ(dds::send_buffer_bytes(), std::nullopt) << "the domain ends with its last participant";
  unsetenv("CYCLONEDDS_URI");
  EXPECT_EQ(dds::send_buffer_advice(dds::kSendBufferBytes), "");
  EXPECT_NE(dds::send_buffer_advice(212'992).find("208 KiB"), std::string::npos);
}

TEST(DdsProcess, AMismatchIsNamedOnBothSidesByTopicAndPolicyAndLoggedOnce) {
  const Lines lines;
  const dds::Participant driver(test_domain());
  const dds::Participant daemon(test_domain());
  wire::Qos slow = wire::Topic<wire::ForceSample>::kQos;
  slow.deadline_ns *= 10;
  const dds::Reader<wire::ForceSample> reader(daemon);
  const dds::Writer<wire::ForceSample> writer(driver, slow);
  wire::Qos unreliable = wire::Topic<wire::RegistrationState>::kQos;
  unreliable.reliable = false;
  const dds::Writer<wire::RegistrationState> states(daemon, unreliable);
  const dds::Reader<wire::RegistrationState> display(driver);
  ASSERT_TRUE(
      eventually([&] { return driver.mismatches().found().size() == 2 && daemon.mismatches().found().size() == 2; }));
  EXPECT_EQ(daemon.mismatches().text(),
            "ForceSample: a writer offers less than this program requires (deadline); "
            "RegistrationState: a reader requires more than this program offers (reliability)");
  EXPECT_EQ(driver.mismatches().text(),
            "ForceSample: a reader requires more than this program offers (deadline); "
            "RegistrationState: a writer offers less than this program requires (reliability)");
  const dds::Writer<wire::ForceSample> again(driver, slow);
  const dds::Writer<wire::ForceSample> fits(driver);
  ASSERT_TRUE(eventually([&] { return fits.matched_readers() == 1; }));
  EXPECT_EQ(daemon.mismatches().found().size(), 2U);
  EXPECT_EQ(lines.count("ForceSample: a writer offers less"), 1U);
}

TEST(DdsProcess, AWriterOfAnotherTypeIsNamed) {
  const dds::Participant driver(test_domain());
  const dds::Participant daemon(test_domain());
  const dds::Reader<wire::ForceSample> reader(daemon);
  const dds::Entity writer =
      dds::untyped::make_writer(driver, wire::Topic<wire::RangeSample>::descriptor(),
                                wire::Topic<wire::ForceSample>::kName, wire::Topic<wire::ForceSample>::kQos);
  ASSERT_TRUE(eventually([&] { return !daemon.mismatches().found().empty(); }));
  EXPECT_EQ(daemon.mismatches().text(), "ForceSample: a writer of another type is here");
}

} // namespace
