// The listener and its sockets, with records that the tests set.
#include "clients/gateway/server.hpp"

#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <future>
#include <iterator>
#include <limits>
#include <thread>
#include <vector>

#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include "idl/boot_clock.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/gateway/socket_client.hpp"

namespace bregma::gateway {
namespace {

using namespace std::chrono_literals;
using test::StateClient;

constexpr std::array kTools{RecordKind::kTool};

class ServerTest : public ::testing::Test {
protected:
  ServerTest() {
    auto opened = Server::open(io_, shared_, {.port = 0});
    EXPECT_TRUE(opened);
    server_ = std::move(*opened);
    shared_->site.access = make_access(true, false, port(), {}, {});
    shared_->site.page["/index.html"] = std::make_shared<const std::string>("page");
    thread_ = std::thread([this] { io_.run(); });
  }
  ~ServerTest() override {
    io_.stop();
    thread_.join();
  }
  [[nodiscard]] std::uint16_t port() const { return server_->port(); }

  // A new state of the probe.
  void publish(double x) {
    Tool tool{};
    std::strcpy(tool.tool, "Probe");
    tool.tip_mm[0] = x;
    tool.valid_until_ms = std::numeric_limits<double>::infinity();
    (void)shared_->store.replace(kTools, {make_record(RecordKind::kTool, tool, wire::boot_now_ns())});
    server_->news();
  }

  template <class Condition> bool reaches(Condition condition, std::chrono::seconds limit = 10s) {
    for (const auto end = std::chrono::steady_clock::now() + limit; std::chrono::steady_clock::now() < end;) {
      if (condition()) {
        return true;
      }
      std::this_thread::sleep_for(5ms);
    }
    return condition();
  }

  boost::asio::io_context io_{1};
  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
  std::unique_ptr<Server> server_;
  std::thread thread_;
};

double x_of(const std::string &frame) {
  Tool tool;
  std::memcpy(&tool, frame.data() + sizeof(FrameHeader) + sizeof(RecordHeader), sizeof tool);
  return tool.tip_mm[0];
}

TEST_F(ServerTest, ServesThePageWithItsPolicy) {
  const auto response = test::get(port(), "/");
  EXPECT_EQ(response.result_int(), 200U);
  EXPECT_EQ(response.body(), "page");
  const auto policy = response["Content-Security-Policy"];
  EXPECT_NE(policy.find("default-src 'none'"), boost::beast::string_view::npos);
  EXPECT_EQ(response["X-Content-Type-Options"], "nosniff");
}

TEST_F(ServerTest, AFileOfACaseIsSentWhole) {
  const test::TemporaryFolder folder;
  const std::string content(3'000'000, 'v');
  folder.write("image", content);
  const std::filesystem::path file = folder.path() / "image";
  shared_->site.sources.case_file = [file](auto, auto) { return std::optional(file); };
  const auto response = test::get(port(), "/case/" + std::string(64, 'a') + "/image");
  EXPECT_EQ(response.result_int(), 200U);
  EXPECT_EQ(response.body(), content);
  EXPECT_NE(response["Cache-Control"].find("immutable"), boost::beast::string_view::npos);
}

TEST_F(ServerTest, TheNextFrameFollowsTheAcknowledgementAndHasTheLatestValue) {
  publish(1);
  StateClient client(port());
  EXPECT_EQ(x_of(client.read()), 1.0);
  for (int i = 2; i <= 50; ++i) {
    publish(i);
  }
  client.send(Request{1, 1, 0.0});
  EXPECT_EQ(x_of(client.read()), 50.0);
  EXPECT_TRUE(reaches([&] { return shared_->metrics.frames.Value() == 2.0; }));
}

TEST_F(ServerTest, AWrongAcknowledgementReleasesNothing) {
  publish(1);
  StateClient client(port());
  (void)client.read();
  client.send(Request{1, 7, 0.0});
  publish(2);
  std::this_thread::sleep_for(100ms);
  EXPECT_EQ(shared_->metrics.frames.Value(), 1.0);
}

TEST_F(ServerTest, TheRateIsTheClients) {
  publish(0);
  StateClient client(port());
  client.send(Request{2, 10, 0.0});
  std::atomic<bool> stop{false};
  std::thread publisher([&] {
    for (int i = 1; !stop; ++i) {
      publish(i);
      std::this_thread::sleep_for(2ms);
    }
  });
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 12; ++i) {
    (void)client.next();
  }
  const auto took = std::chrono::steady_clock::now() - begin;
  stop = true;
  publisher.join();
  EXPECT_GT(took, 900ms); // twelve frames, of which the first two need not wait
}

TEST_F(ServerTest, JsonIsTheSameAndAPingIsAnswered) {
  publish(4);
  StateClient client(port(), "/state?format=json");
  EXPECT_NE(client.read().find("\"tip_mm\":[4.0,0.0,0.0]"), std::string::npos);
  client.send(std::string(R"({"ping": 12.5})"));
  client.send(std::string(R"({"ack": 1})"));
  const std::string pong = client.read();
  EXPECT_NE(pong.find("\"client_ms\":12.5"), std::string::npos) << pong;
}

TEST_F(ServerTest, AnInvalidMessageClosesTheSocketAndIsCounted) {
  publish(1);
  StateClient client(port());
  (void)client.read();
  client.send(std::string("drop tables"));
  EXPECT_THROW((void)client.read(), boost::system::system_error);
  EXPECT_EQ(shared_->metrics.closed_bad.Value(), 1.0);
  EXPECT_TRUE(reaches([&] { return shared_->metrics.watchers.Value() == 0.0; }));
}

TEST_F(ServerTest, AMessageLongerThanAnyRequestClosesTheSocket) {
  StateClient client(port());
  EXPECT_THROW(
      {
        client.send(std::string(100'000, 'x'));
        (void)client.read();
      },
      boost::system::system_error);
}

TEST_F(ServerTest, APageOfAnotherOriginCannotOpenTheSocket) {
  EXPECT_THROW(StateClient(port(), "/state", {{"Origin", "http://evil.example"}}), boost::system::system_error);
  EXPECT_NO_THROW(StateClient(port(), "/state", {{"Origin", "http://localhost:" + std::to_string(port())}}));
}

// Frames that it has not read, so that the next one follows. Only the number of the latest frame has an effect.
void acknowledge_unread(StateClient &client) {
  try {
    for (std::uint32_t i = 1; i <= 20; ++i) {
      client.send(Request{1, i, 0.0});
    }
  } catch (const boost::system::system_error &) { // it is closed by now
  }
}

TEST_F(ServerTest, ASocketThatDoesNotDrainIsClosedAndCountedAndOthersGoOn) {
  // Frames as large as they get, so that the kernel's buffers fill.
  std::vector<Record> alarms;
  for (int i = 0; i < 4000; ++i) {
    Alarm alarm{};
    std::snprintf(alarm.alarm, sizeof alarm.alarm, "alarm %d", i);
    alarms.push_back(make_record(RecordKind::kAlarm, alarm));
  }
  constexpr std::array kAlarms{RecordKind::kAlarm};
  (void)shared_->store.replace(kAlarms, alarms);
  StateClient stuck(port());
  const int small = 4096;
  setsockopt(stuck.descriptor(), SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
  StateClient other(port());
  std::uint32_t frames = 0;
  EXPECT_TRUE(reaches([&] {
    publish(static_cast<double>(frames));
    (void)other.next();
    ++frames;
    acknowledge_unread(stuck);
    return shared_->metrics.closed_slow.Value() > 0.0;
  }));
  EXPECT_GT(frames, 60U) << "the other one was served meanwhile";
  EXPECT_TRUE(reaches([&] { return shared_->metrics.watchers.Value() == 1.0; }));
}

std::size_t open_files() {
  const std::filesystem::directory_iterator files("/proc/self/fd");
  return static_cast<std::size_t>(std::distance(begin(files), end(files)));
}

TEST_F(ServerTest, AThousandConnectionsLeaveNothing) {
  publish(1);
  const std::size_t before = open_files();
  for (int i = 0; i < 1000; ++i) {
    switch (i % 4) {
    case 0:
      EXPECT_EQ(test::get(port(), "/").result_int(), 200U);
      break;
    case 1: {
      boost::asio::io_context io;
      (void)test::connect_to(io, port()); // and closed at once
      break;
    }
    case 2: {
      boost::asio::io_context io;
      auto socket = test::connect_to(io, port());
      boost::asio::write(socket, boost::asio::buffer("GET / HT", 8)); // half a request
      break;
    }
    default:
      StateClient(port()).next();
    }
  }
  EXPECT_TRUE(reaches([&] {
    return shared_->metrics.open_connections.Value() == 0.0 && shared_->metrics.watchers.Value() == 0.0 &&
           open_files() == before;
  })) << shared_->metrics.open_connections.Value()
      << " connections, " << open_files() << " files, " << before << " before";
  std::promise<std::size_t> watchers; // read by the server's own thread
  boost::asio::post(io_, [&] { watchers.set_value(shared_->watchers.size()); });
  EXPECT_EQ(watchers.get_future().get(), 0U);
}

TEST(Listening, AnAddressThatIsNotOursIsNamed) {
  boost::asio::io_context io;
  const auto opened = Server::open(io, std::make_shared<Shared>(), {.address = "192.0.2.1", .port = 1});
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().message, "cannot listen on 192.0.2.1 port 1: Cannot assign requested address");
  EXPECT_TRUE(is_loopback("127.0.0.1"));
  EXPECT_TRUE(is_loopback("::1"));
  EXPECT_FALSE(is_loopback("0.0.0.0"));
  EXPECT_FALSE(is_loopback("localhost"));
}

} // namespace
} // namespace bregma::gateway
