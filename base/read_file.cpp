#include "base/read_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <system_error>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

namespace bregma::base {
namespace {

class Descriptor {
public:
  // O_NONBLOCK: to open a pipe without a writer must not wait for one.
  explicit Descriptor(const std::filesystem::path &file)
      : fd_(::open(file.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC)) {}
  ~Descriptor() {
    if (fd_ >= 0) {
      ::close(fd_);
    }
  }
  Descriptor(const Descriptor &) = delete;
  Descriptor &operator=(const Descriptor &) = delete;
  [[nodiscard]] int get() const { return fd_; }

private:
  int fd_;
};

std::string reason() { return std::generic_category().message(errno); }

} // namespace

Result<std::string> read_file(const std::filesystem::path &file, std::size_t max_bytes) {
  const Descriptor descriptor(file);
  struct stat status {};
  if (descriptor.get() < 0 || ::fstat(descriptor.get(), &status) != 0) {
    return failure(file.string() + ": " + reason());
  }
  if (!S_ISREG(status.st_mode)) {
    return failure(file.string() + (S_ISDIR(status.st_mode) ? ": is a folder, not a file" : ": is not a regular file"));
  }
  const auto too_large = [&] {
    return failure(file.string() + ": is larger than " + std::to_string(max_bytes >> 20) + " MiB");
  };
  if (static_cast<std::uintmax_t>(status.st_size) > max_bytes) {
    return too_large();
  }
  // One byte more than the stated size shows the end of a file that does not grow meanwhile.
  constexpr std::size_t kMinChunk = std::size_t{1} << 12;
  std::string out;
  std::size_t chunk = static_cast<std::size_t>(status.st_size) + 1;
  out.reserve(chunk + kMinChunk);
  for (;;) {
    const std::size_t before = out.size();
    out.resize(before + chunk);
    const ssize_t count = ::read(descriptor.get(), out.data() + before, chunk);
    if (count < 0 && errno == EINTR) {
      out.resize(before);
      continue;
    }
    if (count < 0) {
      return failure(file.string() + ": cannot be read: " + reason());
    }
    out.resize(before + static_cast<std::size_t>(count));
    if (count == 0) {
      return out;
    }
    if (out.size() > max_bytes) {
      return too_large();
    }
    chunk = std::max(chunk - static_cast<std::size_t>(count), kMinChunk);
  }
}

} // namespace bregma::base
