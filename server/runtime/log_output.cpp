#include "server/runtime/log_output.hpp"

#include <algorithm>
#include <climits>

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

namespace bregma::runtime {

LogOutput::LogOutput(int fd) : fd_(fd), terminal_(::isatty(fd) == 1) {
  struct stat status {};
  if (::fstat(fd, &status) != 0 || S_ISREG(status.st_mode)) {
    return;
  }
  socket_ = S_ISSOCK(status.st_mode); // that of systemd's journal
  if (!socket_) {
    // O_NONBLOCK on fd itself would hold for every process that shares it.
    own_fd_ = ::open(("/proc/self/fd/" + std::to_string(fd)).c_str(), O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
  }
}

LogOutput::~LogOutput() {
  if (own_fd_ >= 0) {
    ::close(own_fd_);
  }
}

bool LogOutput::write(std::string_view line) {
  if (stated_ < dropped_) {
    if (!send("... " + std::to_string(dropped_ - stated_) + " lines of the log were dropped: they were not read\n")) {
      ++dropped_;
      return false;
    }
    stated_ = dropped_;
  }
  if (!send(line)) {
    ++dropped_;
    return false;
  }
  return true;
}

// A text is written as a whole or not at all: what is left of it goes first with the next one.
bool LogOutput::send(std::string_view text) {
  if (!rest_.empty()) {
    rest_.erase(0, write_some(rest_));
    if (!rest_.empty()) {
      return false;
    }
  }
  const std::size_t done = write_some(text);
  if (done == 0 && !text.empty()) {
    return false;
  }
  rest_ = text.substr(done);
  return true;
}

std::size_t LogOutput::write_some(std::string_view text) const {
  ssize_t done = 0;
  if (socket_) {
    done = ::send(fd_, text.data(), text.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
  } else if (own_fd_ >= 0) {
    done = ::write(own_fd_, text.data(), text.size());
  } else {
    pollfd ready{fd_, POLLOUT, 0}; // a file of another user cannot be opened again; one that is ready takes PIPE_BUF
    if (::poll(&ready, 1, 0) == 1 && (ready.revents & POLLOUT) != 0) {
      done = ::write(fd_, text.data(), std::min<std::size_t>(text.size(), PIPE_BUF));
    }
  }
  return done > 0 ? static_cast<std::size_t>(done) : 0;
}

} // namespace bregma::runtime
