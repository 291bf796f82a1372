// How programs find each other on one host. Each program is a Cyclone domain of its own in this process, with its own
// ports, which counts as the same domain on the network.
#include <chrono>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <unistd.h>

#include "idl/dds.hpp"

// Cyclone has no frame pointers: without them its losses are recognised (tests/support/lsan.supp) only by slow
// unwinding. NOLINTNEXTLINE(bugprone-reserved-identifier,readability-identifier-naming): the sanitizer's own name
extern "C" const char *__asan_default_options() { return "fast_unwind_on_malloc=0"; }

namespace {

using namespace bregma;
using namespace std::chrono_literals;

constexpr std::size_t kClients = 36; // more than the ports that peers know (MaxAutoParticipantIndex)

class Host {
public:
  explicit Host(bool multicast) {
    const std::string network = "<CycloneDDS><Domain><Discovery><ExternalDomainId>" +
                                std::to_string(200 + getpid() % 30) + "</ExternalDomainId></Discovery>" +
                                (multicast ? "" : "<General><AllowMulticast>false</AllowMulticast></General>") +
                                "</Domain></CycloneDDS>";
    setenv("CYCLONEDDS_URI", (std::string(dds::default_configuration()) + "," + network).c_str(), 1);
  }
  ~Host() { unsetenv("CYCLONEDDS_URI"); }
  Host(const Host &) = delete;
  Host &operator=(const Host &) = delete;

  std::unique_ptr<dds::Participant> program(dds::Role role) {
    return std::make_unique<dds::Participant>(1000 + ++programs_, role);
  }

private:
  std::uint32_t programs_ = 0;
};

struct Displays {
  explicit Displays(Host &host, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      programs.push_back(host.program(dds::Role::kClient));
      readers.push_back(std::make_unique<dds::Reader<wire::SystemHealth>>(*programs.back()));
    }
  }
  std::vector<std::unique_ptr<dds::Participant>> programs;
  std::vector<std::unique_ptr<dds::Reader<wire::SystemHealth>>> readers;
};

template <class T> std::uint32_t matched(const dds::Writer<T> &writer, std::uint32_t wanted) {
  const auto end = std::chrono::steady_clock::now() + 30s; // only limits a hang
  while (writer.matched_readers() < wanted && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(5ms);
  }
  return writer.matched_readers();
}

TEST(Discovery, ADaemonThatStartsAmongManyClientsServesThemAllWithoutMulticast) {
  Host host(false);
  const Displays displays(host, kClients);
  const auto daemon = host.program(dds::Role::kServer);
  const dds::Writer<wire::SystemHealth> health(*daemon);
  EXPECT_EQ(matched(health, kClients), kClients);
}

TEST(Discovery, ClientsFindEachOtherWithoutADaemon) {
  Host host(true);
  const Displays displays(host, kClients);
  const auto publisher = host.program(dds::Role::kClient);
  const dds::Writer<wire::SystemHealth> health(*publisher);
  EXPECT_EQ(matched(health, kClients), kClients);
}

TEST(Discovery, ADaemonFindsItsClientsAlsoIfNoKnownPortIsFree) {
  Host host(true);
  std::vector<std::unique_ptr<dds::Participant>> others;
  for (std::size_t i = 0; i < kClients; ++i) {
    others.push_back(host.program(dds::Role::kServer));
  }
  const Displays displays(host, 1);
  const auto daemon = host.program(dds::Role::kServer);
  const dds::Writer<wire::SystemHealth> health(*daemon);
  EXPECT_EQ(matched(health, 1), 1U);
}

} // namespace
