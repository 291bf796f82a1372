// Arbitrary bytes as session.json, and arbitrary values in one whose checksum is right: nothing crashes, what is
// accepted can be saved and restored again, and a file that is accepted is refused when it is cut.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <string_view>

#include <boost/crc.hpp>
#include <nlohmann/json.hpp>

#include "server/session/snapshot.hpp"

namespace {

using namespace bregma;
using nlohmann::json;

void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

bool restore(const std::string &text) {
  const auto data = server::from_json(text, "session.json");
  require(data || !data.error().message.empty());
  if (!data) {
    return false;
  }
  require(server::from_json(server::to_json(*data), "session.json").has_value());
  const std::size_t end = text.find_last_of('}') + 1;
  require(!server::from_json(text.substr(0, std::hash<std::string>()(text) % end), "session.json"));
  return true;
}

// The file whose session these values are.
std::string with_checksum(const json &session) {
  const auto dump = [](const json &value) { return value.dump(-1, ' ', false, json::error_handler_t::replace); };
  const std::string content = dump(session);
  boost::crc_32_type crc;
  crc.process_bytes(content.data(), content.size());
  char sum[16];
  (void)std::snprintf(sum, sizeof sum, "%08x", static_cast<unsigned>(crc.checksum()));
  static const std::string version = dump(json::parse(server::to_json({}))["bregma_session"]);
  return "{\"bregma_session\":" + version + ",\"crc32\":\"" + sum + "\",\"session\":" + content + "}\n";
}

// A session with every part.
server::SessionData complete() {
  server::SessionData out;
  out.case_folder = "/cases/colin27";
  out.case_id = "colin27";
  out.tips["Stylus"] = {};
  out.fiducials["F1"] = {};
  out.surface.push_back({});
  out.accepted = server::RegistrationAccepted{};
  out.checks["Nasion"] = {};
  return out;
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  static const std::string whole = server::to_json(complete());
  static const json session_of_whole = json::parse(whole)["session"];
  static const bool readable = restore(whole);
  require(readable);
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string text(reinterpret_cast<const char *>(data), size);
  static_cast<void>(restore(text));
  // "/checks/Nasion/error_mm = 1e400" in the complete session.
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || text.front() != '/') {
    return 0;
  }
  const json value = json::parse(text.substr(equals + 1), nullptr, false);
  // A path with a long index would make a list of as many members, which no file of this size holds.
  const std::string path = text.substr(0, equals);
  constexpr std::size_t kMaxDigits = 3;
  for (std::size_t digits = 0; const char letter : path) {
    digits = letter >= '0' && letter <= '9' ? digits + 1 : 0;
    if (digits > kMaxDigits) {
      return 0;
    }
  }
  if (value.is_discarded()) {
    return 0;
  }
  try {
    json session = session_of_whole;
    session[json::json_pointer(path)] = value;
    static_cast<void>(restore(with_checksum(session)));
  } catch (const json::exception &) { // the path does not fit the session
  }
  return 0;
}
