#include "base/write_file.hpp"

#include <cerrno>
#include <system_error>

#include <fcntl.h>
#include <unistd.h>

namespace bregma::base {
namespace {

namespace fs = std::filesystem;

// 0, or the error's number.
int write_all(const fs::path &file, std::string_view content) {
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOCTTY | O_CLOEXEC, 0666);
  if (descriptor < 0) {
    return errno;
  }
  int problem = 0;
  while (!content.empty() && problem == 0) {
    const ssize_t count = ::write(descriptor, content.data(), content.size());
    if (count >= 0) {
      content.remove_prefix(static_cast<std::size_t>(count));
    } else if (errno != EINTR) {
      problem = errno;
    }
  }
  // Some file systems report a full disk only here.
  return ::close(descriptor) == 0 || problem != 0 ? problem : errno;
}

} // namespace

std::string write_problem(int error_number) {
  return error_number == ENOSPC || error_number == EDQUOT ? "the disk is full"
                                                          : std::generic_category().message(error_number);
}

Result<void> write_file(const fs::path &file, std::string_view content) {
  std::error_code ignored;
  const bool direct = fs::exists(file, ignored) && !fs::is_regular_file(file, ignored);
  // A link is followed, or its target would keep its content.
  const fs::path place = !direct && fs::is_symlink(file, ignored) ? fs::weakly_canonical(file, ignored) : file;
  const fs::path fresh = direct ? place : fs::path(place.string() + ".new");
  int problem = fs::is_directory(file, ignored) ? EISDIR : write_all(fresh, content);
  if (problem == 0 && !direct) {
    std::error_code renamed;
    fs::rename(fresh, place, renamed);
    problem = renamed.value();
  }
  if (problem != 0) {
    if (!direct) {
      fs::remove(fresh, ignored);
    }
    return failure(file.string() + ": cannot be written: " + write_problem(problem));
  }
  return {};
}

} // namespace bregma::base
