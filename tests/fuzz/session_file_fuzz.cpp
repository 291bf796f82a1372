// Arbitrary bytes as a session file: nothing crashes, every part is read or refused, and a file that was read whole is
// refused, at the latest while it is read, when pages are missing.
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <string_view>

#include "casefile/session_file/session_file.hpp"
#include "tests/support/temporary_folder.hpp"

namespace {

using namespace bregma;

void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

// Whether everything in it could be read.
bool read_all(const std::filesystem::path &file) {
  const auto reader = casefile::SessionReader::open(file);
  require(reader || !reader.error().message.empty());
  if (!reader) {
    return false;
  }
  const auto attachments = reader->attachments();
  bool whole = reader->topics() && reader->meta() && attachments;
  for (const auto &name : attachments ? *attachments : std::vector<std::string>()) {
    whole = reader->attachment(name) && whole;
  }
  const auto frames = reader->each<wire::TrackerFrame>([](const wire::TrackerFrame &, std::int64_t) {});
  const auto states = reader->each<wire::NavigationState>([](const wire::NavigationState &, std::int64_t) {});
  return frames && states && whole;
}

void write(const test::TemporaryFolder &folder, std::string_view name, std::string_view content) {
  for (const char *more : {"-wal", "-shm", "-journal"}) {
    std::error_code ignored;
    std::filesystem::remove(folder / (std::string(name) + more), ignored);
  }
  static_cast<void>(folder.write(std::string(name), content));
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  static const test::TemporaryFolder scratch;
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data), size);
  write(scratch, "a.bregma", content);
  if (read_all(scratch / "a.bregma")) {
    constexpr std::size_t kPage = 512; // the smallest of SQLite
    write(scratch, "cut.bregma", content.substr(0, std::hash<std::string_view>()(content) % (size - kPage)));
    require(!read_all(scratch / "cut.bregma"));
  }
  return 0;
}
