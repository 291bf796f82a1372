#include "server/session_recording.hpp"

#include <ctime>
#include <utility>

#include "base/read_file.hpp"
#include "idl/names.hpp"

namespace bregma::server {
namespace {

namespace fs = std::filesystem;

constexpr const char *kSessions = "sessions"; // the case's folder for session files

std::string utc_text(std::int64_t now_ns, const char *format) {
  const std::time_t seconds = now_ns / 1'000'000'000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[64];
  return {text, std::strftime(text, sizeof text, format, &utc)};
}

// In total. A file that does not fit is not attached: a case folder may contain more than the case.
constexpr std::size_t kMaxAttachments = std::size_t{512} << 20;

bool belongs_in_a_report(const fs::path &file) {
  if (file.filename() == "patient.json") { // name, ID and birth date stay beside the case
    return false;
  }
  const std::string extension = file.extension().string();
  return extension == ".toml" || extension == ".json" || extension == ".ply";
}

} // namespace

fs::path new_session_file(const casefile::Case &a_case, std::int64_t now_ns) {
  const fs::path folder = a_case.folder / kSessions;
  std::error_code ignored; // the recorder reports the reason if the folder is missing
  fs::create_directories(folder, ignored);
  const std::string name = utc_text(now_ns, "%Y%m%dT%H%M%SZ");
  fs::path file = folder / (name + ".db");
  for (int i = 2; fs::exists(file, ignored); ++i) {
    file = folder / (name + "-" + std::to_string(i) + ".db");
  }
  return file;
}

std::vector<casefile::Attachment> attachments_of(const casefile::Case &a_case, const std::string &config_toml) {
  std::vector<casefile::Attachment> out{{"bregmad.toml", config_toml}};
  std::size_t bytes = 0;
  std::error_code ignored; // the case was read just before; a file deleted since then is not attached
  for (fs::recursive_directory_iterator entry(a_case.folder, ignored), end; entry != end; entry.increment(ignored)) {
    if (entry->is_directory(ignored) && entry->path().filename() == kSessions) {
      entry.disable_recursion_pending();
    }
    if (!entry->is_regular_file(ignored) || !belongs_in_a_report(entry->path())) {
      continue;
    }
    auto body = base::read_file(entry->path(), kMaxAttachments - bytes);
    if (body) {
      bytes += body->size();
      out.push_back({entry->path().lexically_relative(a_case.folder).string(), std::move(*body)});
    }
  }
  return out;
}

std::vector<casefile::MetaEntry> meta_of(const casefile::Case &a_case, std::int64_t now_ns) {
  return {{"case", a_case.id},
          {"folder", a_case.folder.string()},
          {"started", utc_text(now_ns, "%Y-%m-%dT%H:%M:%SZ")},
          {"version", BREGMA_VERSION},
          {"build", BREGMA_BUILD}};
}

} // namespace bregma::server
