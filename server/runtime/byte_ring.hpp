// Bounded ring of records of any size, from one writer thread to one reader thread. Both sides are wait-free. A record
// that does not fit is dropped and counted.
//
// The reader holds records until it releases them: next() advances, release() frees the space, and rewind() returns to
// the oldest unreleased record. So records survive a failed write to disk.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

namespace bregma::runtime {

// The padding keeps the counters of the two ends on separate cache lines.
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding)
class ByteRing {
public:
  // capacity in bytes, rounded up to a power of two, at least 4096. All memory is allocated and touched here.
  explicit ByteRing(std::size_t capacity);

  // Writer thread. The record is head followed by body. False if it did not fit.
  bool try_push(std::span<const std::byte> head, std::span<const std::byte> body) noexcept;

  // Reader thread. The next record, or nullopt if all have been read. The bytes are aligned to 8 and stay valid until
  // release().
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
  alignas(64) std::atomic<std::uint64_t> head_{0}; // bytes written in total
  std::atomic<std::uint64_t> pushed_{0};           // records, without the dropped ones
  std::atomic<std::uint64_t> dropped_{0};
  alignas(64) std::atomic<std::uint64_t> tail_{0}; // bytes released in total
  std::uint64_t cursor_ = 0;                       // used by the reader; between tail and head
};

} // namespace bregma::runtime
