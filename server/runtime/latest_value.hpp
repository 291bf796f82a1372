// The latest value of a variable, from one writer thread to any number of reader threads.
//
// A ring of kSlots copies: the writer fills the slot after the published one and then publishes it. The writer is
// wait-free. A reader copies the published slot, and retries only if the writer has published kSlots - 2 more values in
// the meantime. So a writer that is preempted during a store never delays a reader, for any priorities. With a plain
// sequence lock a FIFO reader on the same core would spin forever.
//
// The copies are atomic words. Release stores and acquire loads order them relative to the published count. This needs
// no fence, costs nothing on x86, and has no data race, also for the thread sanitizer.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <type_traits>

namespace bregma::runtime {

template <class T> class LatestValue {
  static_assert(std::is_trivially_copyable_v<T> && std::is_default_constructible_v<T>);

public:
  // One thread only.
  void store(const T &value) noexcept {
    const std::uint64_t count = published_.load(std::memory_order_relaxed) + 1;
    Slot &slot = slots_[count % kSlots];
    const auto *bytes = reinterpret_cast<const unsigned char *>(&value);
    for (std::size_t i = 0; i < kWords; ++i) {
      std::uint64_t word = 0;
      std::memcpy(&word, bytes + 8 * i, bytes_of_word(i));
      slot[i].store(word, std::memory_order_release);
    }
    published_.store(count, std::memory_order_release);
  }

  // Number of values stored so far.
  [[nodiscard]] std::uint64_t count() const noexcept { return published_.load(std::memory_order_acquire); }

  // The latest value, or nullopt before the first.
  [[nodiscard]] std::optional<T> load() const noexcept {
    std::uint64_t seen = 0;
    T value;
    return load_newer(value, seen) ? std::optional<T>(value) : std::nullopt;
  }

  // Copies the latest value if it is newer than value number `seen`, and updates `seen`.
  // Start with seen = 0. Returns false and changes nothing if there is no newer value.
  [[nodiscard]] bool load_newer(T &value, std::uint64_t &seen) const noexcept {
    auto *bytes = reinterpret_cast<unsigned char *>(&value);
    for (;;) {
      const std::uint64_t count = published_.load(std::memory_order_acquire);
      if (count == seen) {
        return false;
      }
      const Slot &slot = slots_[count % kSlots];
      for (std::size_t i = 0; i < kWords; ++i) {
        const std::uint64_t word = slot[i].load(std::memory_order_acquire);
        std::memcpy(bytes + 8 * i, &word, bytes_of_word(i));
      }
      // Slot `count` is refilled by store number count + kSlots, which begins after count + kSlots - 1 is published.
      if (published_.load(std::memory_order_relaxed) - count < kSlots - 1) {
        seen = count;
        return true;
      }
    }
  }

private:
  static constexpr std::size_t kSlots = 4;
  static constexpr std::size_t kWords = (sizeof(T) + 7) / 8;
  using Slot = std::array<std::atomic<std::uint64_t>, kWords>;

  static constexpr std::size_t bytes_of_word(std::size_t i) {
    return i + 1 < kWords ? 8 : sizeof(T) - 8 * (kWords - 1);
  }

  alignas(64) std::atomic<std::uint64_t> published_{0};
  alignas(64) std::array<Slot, kSlots> slots_{};
};

// A reader's end of a latest value: the copy that it works with, and which one that is. One thread.
template <class T> class LatestInput {
public:
  // source: outlives this input. Once, before the first refresh.
  void connect(const LatestValue<T> &source) noexcept { source_ = &source; }
  // Brings the copy up to date; true when there was a newer value.
  bool refresh() noexcept { return source_->load_newer(value_, seen_); }
  // As of the last refresh; a default value before the first one that was stored.
  [[nodiscard]] const T &value() const noexcept { return value_; }

private:
  const LatestValue<T> *source_ = nullptr;
  T value_{};
  std::uint64_t seen_ = 0;
};

} // namespace bregma::runtime
