#include <cerrno>
#include <fstream>
#include <iterator>
#include <string>
#include <system_error>

#include <fcntl.h>
#include <unistd.h>

#include "base/write_file.hpp"
#include "server/session/snapshot.hpp"

namespace bregma::server {
namespace {

namespace fs = std::filesystem;

class Descriptor {
public:
  Descriptor(const fs::path &path, int flags) : fd_(::open(path.c_str(), flags | O_CLOEXEC, 0600)) {}
  ~Descriptor() {
    if (fd_ >= 0) {
      ::close(fd_);
    }
  }
  Descriptor(const Descriptor &) = delete;
  Descriptor &operator=(const Descriptor &) = delete;

  [[nodiscard]] bool write_all(const std::string &text) const {
    std::size_t done = 0;
    while (done < text.size()) {
      const ssize_t count = ::write(fd_, text.data() + done, text.size() - done);
      if (count < 0 && errno != EINTR) {
        return false;
      }
      done += count > 0 ? static_cast<std::size_t>(count) : 0;
    }
    return true;
  }
  [[nodiscard]] bool open() const { return fd_ >= 0; }
  [[nodiscard]] bool sync() const { return ::fsync(fd_) == 0; }

private:
  int fd_;
};

tl::unexpected<base::Error> system_failure(const fs::path &path, const char *deed) {
  return base::failure(path.string() + ": cannot be " + deed + ": " + base::write_problem(errno));
}

} // namespace

SnapshotFile::SnapshotFile(const fs::path &folder) : path_(folder / "session.json") {
  std::error_code ignored; // the first save reports the reason
  fs::create_directories(path_.parent_path(), ignored);
}

base::Result<void> SnapshotFile::save(const SessionData &data) const {
  const fs::path temporary = path_.string() + ".tmp";
  {
    const Descriptor file(temporary, O_WRONLY | O_CREAT | O_TRUNC);
    if (!file.open() || !file.write_all(to_json(data)) || !file.sync()) {
      return system_failure(temporary, "written");
    }
  }
  if (::rename(temporary.c_str(), path_.c_str()) != 0) {
    return system_failure(path_, "replaced");
  }
  const Descriptor folder(path_.parent_path(), O_RDONLY | O_DIRECTORY); // the rename itself must reach the disk
  if (!folder.open() || !folder.sync()) {
    return system_failure(path_.parent_path(), "synced");
  }
  return {};
}

base::Result<std::optional<SessionData>> SnapshotFile::load() const {
  std::error_code code;
  if (!fs::exists(path_, code) && !code) {
    return std::nullopt;
  }
  std::ifstream stream(path_, std::ios::binary);
  if (!stream) {
    const auto failure = system_failure(path_, "read");
    set_aside(); // else the next save replaces it
    return failure;
  }
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  auto data = from_json(text, path_.string());
  if (!data) {
    set_aside();
    return tl::unexpected(data.error());
  }
  return std::optional<SessionData>(std::move(*data));
}

fs::path SnapshotFile::set_aside() const {
  constexpr int kMaxKept = 100;
  std::error_code ignored; // if the rename fails, the next save replaces the file
  fs::path kept = path_.string() + ".bad";
  // A link whose target is away is kept as well.
  for (int number = 2; number <= kMaxKept && fs::symlink_status(kept, ignored).type() != fs::file_type::not_found;
       ++number) {
    kept = path_.string() + ".bad." + std::to_string(number);
  }
  fs::rename(path_, kept, ignored);
  return kept;
}

} // namespace bregma::server
