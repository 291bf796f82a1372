// Bytes over real sockets and a pseudo-terminal: failures of a connection, and the end of the driver.
#include <array>
#include <cstdlib>
#include <string>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "drivers/frame/byte_stream.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/frame/system_host.hpp"
#include "tests/support/tcp_device.hpp"
#include "tests/unit/driver/fakes.hpp"

namespace bregma::driver::test {
namespace {

using namespace std::chrono_literals;
using bregma::test::TcpDevice;

class Bytes : public testing::Test {
protected:
  // Reads until `size` bytes have arrived, or no byte arrived for 1 s.
  std::string read(std::size_t size) {
    std::string out;
    while (out.size() < size) {
      const auto bytes = stream.read(io, 1s);
      if (!bytes || bytes->empty()) {
        break;
      }
      out += *bytes;
    }
    return out;
  }

  FakeBus bus;
  SystemHost host;
  Status status;
  Io io{bus, host, status, {.device = "Range"}};
  ByteStream stream;
};

TEST_F(Bytes, GoBothWaysOverTcp) {
  TcpDevice device;
  ASSERT_TRUE(stream.open(device.address(), io));
  device.accept();
  device.send("12.5\n");
  EXPECT_EQ(read(5), "12.5\n");
  ASSERT_TRUE(stream.write("rate 100\n", io));
  EXPECT_EQ(device.receive(9), "rate 100\n");
}

TEST_F(Bytes, ATimeoutWithoutBytesIsNotAnError) {
  TcpDevice device;
  ASSERT_TRUE(stream.open(device.address(), io));
  const auto bytes = stream.read(io, 50ms);
  ASSERT_TRUE(bytes);
  EXPECT_EQ(*bytes, "");
  device.accept();
  device.send("late");
  EXPECT_EQ(read(4), "late"); // the abandoned read has consumed no bytes
}

TEST_F(Bytes, ADeviceThatClosesOrRefusesIsNamedWithTheReason) {
  std::string address;
  {
    TcpDevice device;
    address = device.address();
    ASSERT_TRUE(stream.open(address, io));
    device.accept();
    device.hang_up();
    const auto bytes = stream.read(io, 1s);
    ASSERT_FALSE(bytes);
    EXPECT_EQ(bytes.error().message, address + ": closed by the device");
  }
  const auto again = stream.open(address, io);
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().message, address + ": Connection refused");
  EXPECT_FALSE(again.error().permanent);
  EXPECT_FALSE(stream.write("x", io));
}

TEST_F(Bytes, AStopEndsALongWait) {
  TcpDevice device;
  ASSERT_TRUE(stream.open(device.address(), io));
  host.stop();
  const auto begin = std::chrono::steady_clock::now();
  const auto bytes = stream.read(io, 60s);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 10s);
  ASSERT_TRUE(bytes);
  EXPECT_TRUE(bytes->empty());
}

TEST_F(Bytes, GoBothWaysOverASerialLine) {
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY);
  ASSERT_GE(terminal, 0);
  ASSERT_EQ(grantpt(terminal), 0);
  ASSERT_EQ(unlockpt(terminal), 0);
  std::array<char, 64> path{};
  ASSERT_EQ(ptsname_r(terminal, path.data(), path.size()), 0);
  ASSERT_TRUE(stream.open("serial://" + std::string(path.data()) + "?baud=57600", io));
  ASSERT_EQ(write(terminal, "\x01\x03\n\r", 4), 4); // no byte is interpreted by the line
  EXPECT_EQ(read(4), "\x01\x03\n\r");
  ASSERT_TRUE(stream.write("go", io));
  std::array<char, 8> received{};
  EXPECT_EQ(::read(terminal, received.data(), received.size()), 2);
  EXPECT_EQ(std::string(received.data()), "go");
  close(terminal);
  EXPECT_FALSE(stream.read(io, 1s)); // unplugged
}

TEST_F(Bytes, AMissingSerialLineIsAnErrorWithItsName) {
  const auto opened = stream.open("serial:///dev/no-such-line", io);
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().message, "serial:///dev/no-such-line: No such file or directory");
}

TEST(Address, IsCheckedBeforeOpening) {
  for (const char *good :
       {"tcp://10.0.0.1:4000", "tcp://sensor.local:1", "serial:///dev/ttyUSB0", "serial:///dev/ttyS1?baud=9600"}) {
    EXPECT_TRUE(check_address("address", good)) << good;
  }
  for (const char *bad : {"", "10.0.0.1:4000", "tcp://10.0.0.1", "tcp://:4000", "tcp://a:70000", "tcp://a:x",
                          "serial://ttyUSB0", "serial:///dev/ttyS1?baud=fast", "serial:///dev/ttyS1?baud=0"}) {
    const auto checked = check_address("address", bad);
    ASSERT_FALSE(checked) << bad;
    EXPECT_EQ(checked.error().message,
              "address = " + std::string(bad) + ": must be tcp://HOST:PORT or serial:///DEVICE?baud=N");
  }
}

std::vector<std::string> lines_of(LineSplitter &splitter, std::string_view bytes, std::size_t too_long = 0) {
  std::vector<std::string> out;
  EXPECT_EQ(splitter.take(bytes, [&](std::string_view line) { out.emplace_back(line); }), too_long);
  return out;
}

TEST(LineSplitter, JoinsPieces) {
  LineSplitter splitter(10);
  EXPECT_TRUE(lines_of(splitter, "ab").empty());
  EXPECT_EQ(lines_of(splitter, "c\r\nd\n\nef"), (std::vector<std::string>{"abc", "d", ""}));
  splitter.reset();
  EXPECT_EQ(lines_of(splitter, "g\n"), std::vector<std::string>{"g"});
}

TEST(LineSplitter, SkipsALineThatIsTooLongUpToItsEnd) {
  LineSplitter splitter(4);
  EXPECT_TRUE(lines_of(splitter, "12345").empty());
  EXPECT_TRUE(lines_of(splitter, "678901234567890").empty());
  EXPECT_EQ(lines_of(splitter, "9\n1234\n", 1), std::vector<std::string>{"1234"});
}

} // namespace
} // namespace bregma::driver::test
