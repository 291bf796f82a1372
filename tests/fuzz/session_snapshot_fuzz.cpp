// Arbitrary bytes as session.json: nothing crashes, and a file that is accepted is refused when it is cut.
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <string>

#include "server/session/snapshot.hpp"

namespace {

using namespace bregma;

void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

void restore(const std::string &text) {
  const auto data = server::from_json(text, "session.json");
  require(data || !data.error().message.empty());
  if (!data) {
    return;
  }
  // What is restored can be saved and restored again.
  require(server::from_json(server::to_json(*data), "session.json").has_value());
  const std::size_t end = text.find_last_of('}') + 1;
  require(!server::from_json(text.substr(0, std::hash<std::string>()(text) % end), "session.json"));
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  restore(std::string(reinterpret_cast<const char *>(data), size));
  return 0;
}
