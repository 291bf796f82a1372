#include "server/runtime/state_lock.hpp"

#include <array>
#include <cerrno>
#include <string_view>
#include <system_error>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace bregma::runtime {
namespace {

// The file has one line per process: the owner's first, then those that were refused.
constexpr std::size_t kMaxText = 4096;

std::string read_from(int fd, std::int64_t offset) {
  std::array<char, kMaxText> text{};
  const ssize_t size = ::pread(fd, text.data(), text.size(), offset);
  return size > 0 ? std::string(text.data(), static_cast<std::size_t>(size)) : std::string();
}

// Only digits: another program may have written to the file.
std::string process_in(std::string_view text) {
  const std::size_t first = text.find_first_of("0123456789");
  if (first == std::string_view::npos) {
    return "an unknown process";
  }
  const std::size_t end = text.find_first_not_of("0123456789", first);
  return "process " + std::string(text.substr(first, end == std::string_view::npos ? end : end - first));
}

std::int64_t append_own_process(int fd) {
  const std::string line = std::to_string(::getpid()) + "\n";
  return ::write(fd, line.data(), line.size()) > 0 ? static_cast<std::int64_t>(line.size()) : 0;
}

} // namespace

base::Result<StateLock> StateLock::take(const std::filesystem::path &folder) {
  std::error_code ignored; // open() reports the reason
  std::filesystem::create_directories(folder, ignored);
  const auto file = folder / "bregmad.lock";
  const int fd = ::open(file.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  if (fd < 0) {
    return base::failure(file.string() + ": " + std::generic_category().message(errno));
  }
  StateLock lock(fd, folder);
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) {
      return base::failure(file.string() + ": cannot be locked: " + std::generic_category().message(errno));
    }
    const std::string owner = process_in(read_from(fd, 0));
    (void)append_own_process(fd); // on a full disk the owner does not learn of it
    return base::failure("state.directory = \"" + folder.string() + "\": is in use by another bregmad (" + owner +
                         "): stop it, or use another directory");
  }
  if (::ftruncate(fd, 0) == 0) {
    lock.seen_bytes_ = append_own_process(fd);
  }
  return lock;
}

StateLock::~StateLock() {
  if (fd_ >= 0) {
    ::close(fd_); // releases the lock
  }
}

std::optional<std::string> StateLock::refused_process() {
  struct stat status {};
  if (::fstat(fd_, &status) != 0 || status.st_size <= seen_bytes_) {
    return std::nullopt;
  }
  const std::string text = read_from(fd_, seen_bytes_);
  seen_bytes_ = status.st_size;
  return process_in(text);
}

} // namespace bregma::runtime
