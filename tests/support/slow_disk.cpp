// A library to preload into a program: while the file named by BREGMA_SLOW_DISK exists, every fsync and fdatasync takes
// five seconds, as on a disk or a network that hangs.
#include <cstdlib>
#include <ctime>

#include <sys/syscall.h>
#include <unistd.h>

namespace {

void wait_for_the_disk() {
  const char *flag = std::getenv("BREGMA_SLOW_DISK");
  if (flag != nullptr && access(flag, F_OK) == 0) {
    const timespec time{5, 0};
    nanosleep(&time, nullptr);
  }
}

} // namespace

extern "C" int fsync(int fd) {
  wait_for_the_disk();
  return static_cast<int>(syscall(SYS_fsync, fd));
}

extern "C" int fdatasync(int fd) {
  wait_for_the_disk();
  return static_cast<int>(syscall(SYS_fdatasync, fd));
}
