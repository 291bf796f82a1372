#include "server/runtime/byte_ring.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

namespace bregma::runtime {
namespace {

// A record is its size in one word, then its bytes, padded to whole words. This size marks a jump to the start of the
// ring.
constexpr std::uint64_t kWrap = ~std::uint64_t{0};
constexpr std::size_t kWord = 8;

std::size_t padded(std::size_t size) { return (size + kWord - 1) & ~(kWord - 1); }

} // namespace

ByteRing::ByteRing(std::size_t capacity)
    : mask_(std::bit_ceil(std::max<std::size_t>(capacity, 4096)) - 1), bytes_(new std::byte[mask_ + 1]()) {}

bool ByteRing::try_push(std::span<const std::byte> head, std::span<const std::byte> body) noexcept {
  const std::uint64_t size = head.size() + body.size();
  const std::size_t record = kWord + padded(head.size() + body.size());
  const std::uint64_t begin = head_.load(std::memory_order_relaxed);
  const std::size_t to_end = capacity() - (begin & mask_);
  // A record is contiguous: the space before the end is skipped if it is too short.
  const std::size_t skipped = record <= to_end ? 0 : to_end;
  const std::uint64_t used = begin - tail_.load(std::memory_order_acquire);
  if (used + skipped + record > capacity()) {
    dropped_.store(dropped_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    return false;
  }
  if (skipped > 0) {
    std::memcpy(&bytes_[begin & mask_], &kWrap, kWord);
  }
  std::byte *out = &bytes_[(begin + skipped) & mask_];
  std::memcpy(out, &size, kWord);
  std::copy(head.begin(), head.end(), out + kWord);
  std::copy(body.begin(), body.end(), out + kWord + head.size());
  pushed_.store(pushed_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  head_.store(begin + skipped + record, std::memory_order_release);
  return true;
}

std::optional<std::span<const std::byte>> ByteRing::next() noexcept {
  if (cursor_ == head_.load(std::memory_order_acquire)) {
    return std::nullopt;
  }
  std::uint64_t size = 0;
  std::memcpy(&size, &bytes_[cursor_ & mask_], kWord);
  if (size == kWrap) {
    cursor_ += capacity() - (cursor_ & mask_);
    std::memcpy(&size, &bytes_[cursor_ & mask_], kWord);
  }
  const std::byte *record = &bytes_[cursor_ & mask_] + kWord;
  cursor_ += kWord + padded(static_cast<std::size_t>(size));
  return std::span(record, static_cast<std::size_t>(size));
}

void ByteRing::release() noexcept { tail_.store(cursor_, std::memory_order_release); }

void ByteRing::rewind() noexcept { cursor_ = tail_.load(std::memory_order_relaxed); }

} // namespace bregma::runtime
