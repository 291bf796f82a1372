// Arbitrary bytes as a session file, and a whole one with changed bytes: nothing crashes, every part is read or
// refused, and a whole file is refused, at the latest while it is read, where it is cut. The tests cut a file at 200
// places as well (SessionFile).
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <span>
#include <string>
#include <string_view>

#include <sqlite3.h>

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
  // A damaged list may name the same few thousands of times.
  constexpr std::size_t kMaxAttachments = 4;
  for (std::size_t i = 0; attachments && i < std::min(attachments->size(), kMaxAttachments); ++i) {
    whole = reader->attachment((*attachments)[i]) && whole;
  }
  const auto frames = reader->each<wire::TrackerFrame>([](const wire::TrackerFrame &, std::int64_t) {});
  const auto states = reader->each<wire::NavigationState>([](const wire::NavigationState &, std::int64_t) {});
  return frames && states && whole;
}

// Without what an earlier database left beside it.
std::filesystem::path write(const std::filesystem::path &folder, const std::string &name, std::string_view content) {
  for (const char *more : {"-wal", "-shm", "-journal"}) {
    std::error_code ignored;
    std::filesystem::remove(folder / (name + more), ignored);
  }
  std::ofstream(folder / name, std::ios::binary) << content;
  return folder / name;
}

// SQLite takes its memory piece by piece, where the sanitizer sees each piece, instead of 200 kB for every file that is
// opened, and no locks: one thread.
bool set_up_sqlite() {
  return sqlite3_config(SQLITE_CONFIG_SINGLETHREAD) == SQLITE_OK &&
         sqlite3_config(SQLITE_CONFIG_LOOKASIDE, 0, 0) == SQLITE_OK &&
         sqlite3_config(SQLITE_CONFIG_PAGECACHE, nullptr, 0, 0) == SQLITE_OK &&
         sqlite3_config(SQLITE_CONFIG_MEMSTATUS, 0) == SQLITE_OK;
}

// Attachments and frames, over some pages: small, since every input writes it.
std::string whole_file(const test::TemporaryFolder &folder) {
  const auto file = folder / "whole.session";
  {
    auto writer = casefile::SessionWriter::create(file);
    require(writer.has_value());
    const std::string body(5'000, 'b'); // more than a page
    require(writer->set_meta("case", "colin27") && writer->set_meta("started", "2026-01-01") &&
            writer->attach("scalp.ply", std::as_bytes(std::span(body))));
    for (int i = 0; i < 2; ++i) {
      require(writer->write(i, wire::TrackerFrame{}) && writer->write(i, wire::NavigationState{}));
    }
    require(writer->commit().has_value());
  }
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  static const bool set_up = set_up_sqlite();
  require(set_up);
  static const test::TemporaryFolder scratch;
  static const std::string whole = whole_file(scratch);
  static const bool readable = read_all(write(scratch.path(), "a.session", whole));
  require(readable);
  if (size == 0) {
    return 0;
  }
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): the fuzzer's bytes are the file's
  const std::string_view content(reinterpret_cast<const char *>(data), size);
  const auto number = [&content](std::size_t at) { return std::size_t{static_cast<unsigned char>(content[at])}; };
  switch (number(0) % 3) {
  case 0: // the file
    static_cast<void>(read_all(write(scratch.path(), "a.session", content.substr(1))));
    break;
  case 1: { // bytes of the whole file, each as place and value
    std::string changed = whole;
    for (std::size_t at = 1; at + 3 < size; at += 4) {
      const std::size_t place = number(at) | number(at + 1) << 8U | number(at + 2) << 16U;
      changed[place % changed.size()] = content[at + 3];
    }
    static_cast<void>(read_all(write(scratch.path(), "a.session", changed)));
    break;
  }
  default: { // the whole file, cut
    const std::size_t size_of_cut = std::hash<std::string_view>()(content) % whole.size();
    require(!read_all(write(scratch.path(), "a.session", std::string_view(whole).substr(0, size_of_cut))));
    break;
  }
  }
  return 0;
}
