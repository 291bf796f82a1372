// Bounded ring of records of any size, from one writing thread to one reading thread. Both sides are wait-free; a
// record that does not fit is dropped and counted.
//
// The reader keeps what it has read until it releases it: next() walks on, release() gives the space back, rewind()
// returns to the oldest record that was not released. So records outlive a failed write to disk.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

namespace bregma::runtime {

// The padding keeps the two ends' counters on cache lines of their own.
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding)
class ByteRing {
public:
  // capacity in bytes, rounded up to a power of two, at least 4096. All memory is taken and touched here.
  explicit ByteRing(std::size_t capacity);

  // Writing thread. The record is head followed by body. False when it did not fit.
  bool try_push(std::span<const std::byte> head, std::span<const std::byte> body) noexcept;

  // Reading thread. The next record, or nullopt when all have been read. The bytes begin at a multiple of 8 and stay
  // valid until release().
  [[nodiscard]] std::optional<std::span<const std::byte>> next() noexcept;
  void release() noexcept;
  void rewind() noexcept;

  // Any thread.
  [[nodiscard]] std::uint64_t pushed() const noexcept { return pushed_.load(std::memory_order_acquire); }
  [[nodiscard]] std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::size_t capacity() const noexcept { return mask_ + 1; }

private:
  std::size_t mask_;
  std::unique_ptr<std::byte[]> bytes_;
  alignas(64) std::atomic<std::uint64_t> head_{0}; // bytes ever written
  std::atomic<std::uint64_t> pushed_{0};           // records, without the dropped ones
  std::atomic<std::uint64_t> dropped_{0};
  alignas(64) std::atomic<std::uint64_t> tail_{0}; // bytes ever released
  std::uint64_t cursor_ = 0;                       // the reader's; between tail and head
};

} // namespace bregma::runtime
