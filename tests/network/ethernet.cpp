#include "tests/network/ethernet.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <exception>
#include <fstream>
#include <map>
#include <mutex>
#include <queue>
#include <random>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

namespace bregma::test {
namespace {

using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kHeldBack = 5ms;
constexpr const char *kDevice = "lan0";

int checked(int result, const char *deed) {
  if (result < 0) {
    throw std::system_error(errno, std::generic_category(), deed);
  }
  return result;
}

class File {
public:
  explicit File(int file = -1) : file_(file) {}
  File(File &&other) noexcept : file_(std::exchange(other.file_, -1)) {}
  File &operator=(File &&other) noexcept {
    std::swap(file_, other.file_);
    return *this;
  }
  ~File() {
    if (file_ >= 0) {
      close(file_);
    }
  }
  [[nodiscard]] int get() const { return file_; }

private:
  int file_;
};

// Runs the job on a new thread and passes on its exception.
void on_a_thread(const std::function<void()> &job) {
  std::exception_ptr failure;
  std::thread([&] {
    try {
      job();
    } catch (...) {
      failure = std::current_exception();
    }
  }).join();
  if (failure) {
    std::rethrow_exception(failure);
  }
}

void set_up(const File &socket, const char *device, const std::string &address) {
  ifreq request{};
  std::strncpy(request.ifr_name, device, IFNAMSIZ - 1);
  sockaddr_in in{};
  in.sin_family = AF_INET;
  if (!address.empty()) {
    inet_pton(AF_INET, address.c_str(), &in.sin_addr);
    std::memcpy(&request.ifr_addr, &in, sizeof in);
    checked(ioctl(socket.get(), SIOCSIFADDR, &request), "set an address");
    inet_pton(AF_INET, "255.255.255.0", &in.sin_addr);
    std::memcpy(&request.ifr_netmask, &in, sizeof in);
    checked(ioctl(socket.get(), SIOCSIFNETMASK, &request), "set a netmask");
  }
  checked(ioctl(socket.get(), SIOCGIFFLAGS, &request), "read the flags of a device");
  request.ifr_flags = static_cast<short>(request.ifr_flags | IFF_UP);
  checked(ioctl(socket.get(), SIOCSIFFLAGS, &request), "set up a device");
}

// Of the calling thread's namespace.
void set_neighbour_option(const std::string &option, int value) {
  const std::string path = std::string("/proc/sys/net/ipv4/neigh/") + kDevice + "/" + option;
  std::ofstream file(path);
  if (!(file << value << std::flush)) {
    throw std::system_error(errno, std::generic_category(), "write " + path);
  }
}

struct Namespace {
  File space; // its network namespace
  File tap;
};

// On a thread that ends afterwards: it stays in the namespace.
Namespace make_host(const std::string &address) {
  checked(unshare(CLONE_NEWNET), "make a network namespace");
  Namespace out{File(checked(open("/proc/thread-self/ns/net", O_RDONLY | O_CLOEXEC), "open a namespace")),
                File(checked(open("/dev/net/tun", O_RDWR | O_NONBLOCK | O_CLOEXEC), "open /dev/net/tun"))};
  ifreq request{};
  std::strncpy(request.ifr_name, kDevice, IFNAMSIZ - 1);
  request.ifr_flags = IFF_TAP | IFF_NO_PI;
  checked(ioctl(out.tap.get(), TUNSETIFF, &request), "make a tap device");
  const File socket(checked(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0), "open a socket"));
  set_up(socket, "lo", "");
  set_up(socket, kDevice, address);
  // A host that is silent is asked for its address after a second instead of half a minute: within the shortest cut.
  set_neighbour_option("base_reachable_time_ms", 200);
  set_neighbour_option("delay_first_probe_time", 1);
  set_neighbour_option("ucast_solicit", 1);
  return out;
}

using Address = std::array<std::uint8_t, 6>;
using Frame = std::vector<std::uint8_t>;

struct Delivery {
  Clock::time_point due;
  std::uint64_t order; // of arrival, for frames that are due at the same time
  std::size_t to;
  Frame frame;
  bool operator<(const Delivery &other) const { // the queue's top is the earliest
    return std::pair(due, order) > std::pair(other.due, other.order);
  }
};

} // namespace

class Ethernet::Switch {
public:
  Switch(std::size_t hosts, std::uint64_t seed)
      : faults_(hosts), random_(seed), stop_(checked(eventfd(0, EFD_CLOEXEC), "make an event")) {
    for (std::size_t i = 0; i < hosts; ++i) {
      on_a_thread([&] { hosts_.push_back(make_host("10.77.0." + std::to_string(i + 1))); });
    }
    thread_ = std::thread([this] { run(); });
  }
  ~Switch() {
    const std::uint64_t one = 1;
    (void)!write(stop_.get(), &one, sizeof one);
    thread_.join();
  }

  void set_fault(std::size_t host, const LinkFault &fault) {
    const std::lock_guard lock(mutex_);
    faults_[host] = fault;
  }
  [[nodiscard]] int space(std::size_t host) const { return hosts_[host].space.get(); }

private:
  void run() {
    std::vector<pollfd> files{{stop_.get(), POLLIN, 0}};
    for (const Namespace &host : hosts_) {
      files.push_back({host.tap.get(), POLLIN, 0});
    }
    while ((files[0].revents & POLLIN) == 0) {
      deliver();
      const auto wait = queue_.empty() ? Clock::duration(1s) : std::max(queue_.top().due - Clock::now(), 0ns);
      const timespec timeout{wait / 1s, static_cast<long>(wait % 1s / 1ns)};
      (void)ppoll(files.data(), files.size(), &timeout, nullptr);
      for (std::size_t i = 0; i < hosts_.size(); ++i) {
        if ((files[i + 1].revents & POLLIN) != 0) {
          take_from(i);
        }
      }
    }
  }

  void take_from(std::size_t host) {
    Frame frame(2048);
    for (;;) {
      const ssize_t length = read(hosts_[host].tap.get(), frame.data(), frame.size());
      if (length < 14) {
        return; // nothing is left
      }
      pass(host, Frame(frame.begin(), frame.begin() + length));
    }
  }

  void pass(std::size_t from, const Frame &frame) {
    Address to;
    Address sender;
    std::memcpy(to.data(), frame.data(), to.size());
    std::memcpy(sender.data(), frame.data() + to.size(), sender.size());
    known_[sender] = from;
    const auto known = known_.find(to);
    for (std::size_t host = 0; host < hosts_.size(); ++host) {
      if (host != from && (known == known_.end() || known->second == host)) {
        enqueue(from, host, frame);
      }
    }
  }

  void enqueue(std::size_t from, std::size_t to, const Frame &frame) {
    const std::lock_guard lock(mutex_);
    auto due = Clock::now();
    int copies = 1;
    for (const LinkFault &fault : {faults_[from], faults_[to]}) {
      copies *= fault.cut || happens(fault.loss) ? 0 : happens(fault.duplication) ? 2 : 1;
      due += fault.delay + (happens(fault.reordering) ? kHeldBack : 0ms);
    }
    for (int i = 0; i < copies; ++i) {
      queue_.push({due, order_++, to, frame});
    }
  }

  void deliver() {
    while (!queue_.empty() && queue_.top().due <= Clock::now()) {
      const Delivery &next = queue_.top();
      (void)!write(hosts_[next.to].tap.get(), next.frame.data(), next.frame.size());
      queue_.pop();
    }
  }

  [[nodiscard]] bool happens(double probability) {
    return probability > 0.0 && std::uniform_real_distribution<>(0.0, 1.0)(random_) < probability;
  }

  std::vector<Namespace> hosts_;
  std::mutex mutex_; // of the faults
  std::vector<LinkFault> faults_;
  std::mt19937_64 random_;
  std::map<Address, std::size_t> known_;
  std::priority_queue<Delivery> queue_;
  std::uint64_t order_ = 0;
  File stop_;
  std::thread thread_;
};

std::string Ethernet::unavailable() {
  try {
    on_a_thread([] { (void)make_host("10.77.0.1"); });
    return {};
  } catch (const std::system_error &error) {
    return std::string(error.what()) + " (needs root, or a user namespace with its own network, and /dev/net/tun)";
  }
}

Ethernet::Ethernet(std::size_t hosts, std::uint64_t seed) : switch_(std::make_unique<Switch>(hosts, seed)) {}
Ethernet::~Ethernet() = default;

void Ethernet::set_fault(std::size_t host, const LinkFault &fault) { switch_->set_fault(host, fault); }

void Ethernet::run_on(std::size_t host, const std::function<void()> &job) {
  on_a_thread([&] {
    checked(setns(switch_->space(host), CLONE_NEWNET), "enter a network namespace");
    job();
  });
}

} // namespace bregma::test
