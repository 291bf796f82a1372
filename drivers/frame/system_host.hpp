// The real host: its clock, and a stop that wakes the waiting thread.
#pragma once

#include <atomic>
#include <cstdint>

#include "drivers/frame/io.hpp"

namespace bregma::driver {

class SystemHost final : public Host {
public:
  SystemHost(); // throws std::system_error if no file descriptor is available
  ~SystemHost() override;
  SystemHost(const SystemHost &) = delete;
  SystemHost &operator=(const SystemHost &) = delete;

  [[nodiscard]] std::int64_t now_ns() const override;
  [[nodiscard]] wire::WriteTime write_time() const override;
  [[nodiscard]] bool wait_until(std::int64_t time_ns) override;
  [[nodiscard]] bool stopping() const override { return stopping_.load(std::memory_order_acquire); }

  void stop() noexcept;

private:
  wire::BootIdentity boot_id_;
  std::int64_t utc_minus_boot_ns_; // of the wall clock at the start
  std::atomic<bool> stopping_{false};
  int wake_; // readable once stop() was called
};

} // namespace bregma::driver
