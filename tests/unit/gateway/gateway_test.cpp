// The whole gateway, with a small daemon in this process.
#include "clients/gateway/gateway.hpp"

#include <cmath>
#include <fstream>
#include <thread>

#include <gtest/gtest.h>

#include "tests/support/temporary_folder.hpp"
#include "tests/unit/gateway/socket_client.hpp"
#include "tests/unit/live/fake_daemon.hpp"

namespace bregma::gateway {
namespace {

using namespace std::chrono_literals;
using test::FakeDaemon;
using test::own_domain;
using test::StateClient;

class RunningGateway {
public:
  RunningGateway() : gateway_(*Gateway::open(io_, {.domain = own_domain(), .listen = {.port = 0}})) {
    thread_ = std::thread([this] { io_.run(); });
  }
  ~RunningGateway() {
    io_.stop();
    thread_.join();
  }
  [[nodiscard]] std::uint16_t port() const { return gateway_->port(); }

private:
  boost::asio::io_context io_{1};
  std::unique_ptr<Gateway> gateway_;
  std::thread thread_;
};

// Reads frames until one has a record of this kind that satisfies the condition.
template <class Body, class Condition>
bool receives(StateClient &client, RecordKind kind, Condition condition, std::chrono::seconds limit = 20s) {
  for (const auto end = std::chrono::steady_clock::now() + limit; std::chrono::steady_clock::now() < end;) {
    const std::string frame = client.next();
    RecordHeader header;
    for (std::size_t at = sizeof(FrameHeader); at < frame.size(); at += header.bytes) {
      std::memcpy(&header, frame.data() + at, sizeof header);
      Body body;
      if (header.kind == static_cast<std::uint16_t>(kind)) {
        std::memcpy(&body, frame.data() + at + sizeof header, sizeof body);
        if (condition(body, header)) {
          return true;
        }
      }
    }
  }
  return false;
}

TEST(GatewayTest, ALivePoseArrivesWithItsTimesAndEndsWithTheDaemon) {
  auto daemon = std::make_unique<FakeDaemon>();
  const RunningGateway gateway;
  StateClient client(gateway.port());
  EXPECT_TRUE(receives<Tool>(client, RecordKind::kTool, [](const Tool &tool, const RecordHeader &) {
    if (tool.status != bregma_wire_POSE_LIVE) {
      return false;
    }
    const double now_ms = static_cast<double>(wire::boot_now_ns()) * 1e-6;
    EXPECT_EQ(tool.tip_mm[1], 2.0);
    EXPECT_NEAR(tool.valid_until_ms - tool.published_ms, 90.0, 1e-3);
    EXPECT_NEAR(tool.published_ms - tool.acquired_ms, 10.0, 1e-3);
    EXPECT_GE(now_ms, tool.published_ms);
    return true;
  }));
  daemon.reset();
  EXPECT_TRUE(receives<Tool>(client, RecordKind::kTool, [](const Tool &tool, const RecordHeader &) {
    return tool.status == bregma_wire_POSE_STALE && std::isnan(tool.tip_mm[0]);
  }));
  EXPECT_TRUE(receives<Link>(client, RecordKind::kLink,
                             [](const Link &link, const RecordHeader &) { return link.presence == 1; }));
}

TEST(GatewayTest, AToolWhoseCaseIsClosedEnds) {
  FakeDaemon daemon;
  const RunningGateway gateway;
  StateClient client(gateway.port());
  EXPECT_TRUE(receives<Tool>(client, RecordKind::kTool, [](const Tool &tool, const RecordHeader &) {
    return tool.status == bregma_wire_POSE_LIVE;
  }));
  daemon.case_open = false;
  EXPECT_TRUE(receives<Tool>(client, RecordKind::kTool,
                             [](const Tool &, const RecordHeader &header) { return (header.flags & kEnded) != 0; }));
}

TEST(GatewayTest, MetricsStateTheDaemonAndTheGateway) {
  FakeDaemon daemon;
  const RunningGateway gateway;
  StateClient client(gateway.port());
  EXPECT_TRUE(receives<Tool>(client, RecordKind::kTool, [](const Tool &tool, const RecordHeader &) {
    return tool.status == bregma_wire_POSE_LIVE;
  }));
  const auto text = test::get(gateway.port(), "/metrics").body();
  for (const char *part : {"bregma_gateway_watchers 1", "bregma_link_presence 2", "bregma_session_session 5",
                           "bregma_alarm_severity{alarm=\"drift\",subject=\"\"}",
                           "bregma_tool_status{tool=\"Probe\"} 1", "bregma_gateway_sample_to_socket_seconds_count"}) {
    EXPECT_NE(text.find(part), std::string::npos) << part << " in\n" << text;
  }
}

TEST(GatewayTest, ThePatientIsThatOfTheFileBesideTheCaseOnThisHost) {
  const test::TemporaryFolder folder;
  const std::string path = folder.path().string();
  FakeDaemon daemon;
  const RunningGateway gateway;
  StateClient client(gateway.port());
  const auto alive = [](const Link &link, const RecordHeader &) { return link.presence == 2; };
  EXPECT_TRUE(receives<Link>(client, RecordKind::kLink, alive));
  EXPECT_EQ(test::get(gateway.port(), "/patient").result_int(), 404U) << "no case is loaded";
  daemon.case_folder = path.c_str();
  const auto no_server = [](const CaseProgress &progress, const RecordHeader &) { return progress.state == 1; };
  EXPECT_TRUE(receives<CaseProgress>(client, RecordKind::kCase, no_server));
  EXPECT_EQ(test::get(gateway.port(), "/patient").result_int(), 404U) << "the case names nobody";
  folder.write("patient.json", R"({"name": "Doe, Jane", "id": "02", "birth_date": "1966-01-01", "other": 1})");
  EXPECT_EQ(test::get(gateway.port(), "/patient").body(),
            R"({"birth_date":"1966-01-01","id":"02","name":"Doe, Jane"})");
  const std::string origin = "http://evil.example";
  EXPECT_EQ(test::get(gateway.port(), "/patient", {{"Origin", origin}}).result_int(), 403U);
  daemon.case_folder = "";
}

TEST(GatewayConfig, OutsideLoopbackNothingIsServedWithoutTlsTokenAndName) {
  Config config{.listen = {.address = "0.0.0.0"}};
  EXPECT_EQ(check(config).error().message,
            "--listen 0.0.0.0: outside loopback TLS is needed: give --certificate and --key");
  config.listen.certificate = "site.pem";
  EXPECT_EQ(check(config).error().message, "--certificate and --key are needed together");
  config.listen.key = "site.key";
  EXPECT_EQ(check(config).error().message,
            "--listen 0.0.0.0: outside loopback a token of at least 16 characters is needed: give --token-file");
  config.token = "0123456789abcdef";
  EXPECT_EQ(check(config).error().message,
            "--listen 0.0.0.0: give the name under which browsers ask for it: --host NAME");
  config.hosts = {"display.example"};
  EXPECT_TRUE(check(config));
  EXPECT_TRUE(check(Config{}));
}

TEST(GatewayConfig, ACertificateThatIsNoneIsNamed) {
  const test::TemporaryFolder folder;
  folder.write("site.pem", "no certificate");
  boost::asio::io_context io;
  const std::string file = (folder.path() / "site.pem").string();
  const auto opened = Server::open(io, std::make_shared<Shared>(), {.port = 0, .certificate = file, .key = file});
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().message.find(file + ": this certificate cannot be used"), 0U) << opened.error().message;
}

} // namespace
} // namespace bregma::gateway
