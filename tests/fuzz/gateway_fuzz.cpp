// Outside bytes of the gateway: HTTP requests, messages of /state, and the manifest of a case.
//
// The first byte chooses: bytes of a connection from its begin; bytes after the upgrade, binary or JSON; a manifest.
#include <array>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <string_view>

#include <boost/asio/io_context.hpp>
#include <boost/beast/_experimental/test/stream.hpp>

#include "clients/casefiles/manifest.hpp"
#include "clients/gateway/session.hpp"

namespace {

using namespace bregma::gateway;
namespace asio = boost::asio;
using TestStream = beast::test::stream;

std::shared_ptr<Shared> make_shared_state() {
  auto out = std::make_shared<Shared>();
  out->site.access = make_access(true, false, 80, {}, {});
  out->site.page["/index.html"] = std::make_shared<const std::string>("page");
  out->site.sources.case_json = [] { return std::optional<std::string>("{}"); };
  out->site.sources.metrics = [] { return std::string("metrics"); };
  Tool tool{};
  std::strcpy(tool.tool, "Probe");
  tool.valid_until_ms = std::numeric_limits<double>::infinity();
  constexpr std::array kTools{RecordKind::kTool};
  (void)out->store.replace(kTools, {make_record(RecordKind::kTool, tool)});
  return out;
}

// A connection on which these bytes arrive at once, and then its end. Its session ends with it: nothing is left that
// waits for a timer.
void connect(const std::shared_ptr<Shared> &shared, std::string_view bytes) {
  static asio::io_context io(1); // one for all: its files take longer to open than an input to be read
  TestStream client(io);
  {
    TestStream stream(io, {bytes.data(), bytes.size()});
    stream.connect(client);
    client.close();
    std::make_shared<HttpSession<TestStream>>(std::move(stream), shared)->run();
  }
  io.restart();
  while (io.poll() > 0) {
  }
  if (!shared->watchers.empty() || shared->metrics.open_connections.Value() != 0.0) {
    std::abort();
  }
}

constexpr std::string_view kUpgrade =
    " HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: AQIDBAUGBwgJCgsMDQ4PEA==\r\nSec-WebSocket-Version: 13\r\n\r\n";

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  static const std::shared_ptr<Shared> shared = make_shared_state();
  if (size == 0) {
    return 0;
  }
  const std::string_view rest(reinterpret_cast<const char *>(data) + 1, size - 1);
  switch (data[0] % 4) {
  case 0:
    connect(shared, rest);
    break;
  case 1:
    connect(shared, "GET /state" + std::string(kUpgrade) + std::string(rest));
    break;
  case 2:
    connect(shared, "GET /state?format=json" + std::string(kUpgrade) + std::string(rest));
    break;
  default:
    (void)bregma::casefiles::read_manifest(rest);
  }
  return 0;
}
