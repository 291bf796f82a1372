// Counts the calling thread's heap allocations, so that a test can show that a loop step does not allocate.
//
// Link tests/support/allocation_counter.cpp into the test program: it replaces malloc and related functions (glibc).
// Under the address and thread sanitizers, which also replace them, it does not count and available() is false.
#pragma once

#include <cstdint>

namespace bregma::test {

class AllocationScope {
public:
  AllocationScope() noexcept;
  // Allocations by this thread since the scope began, by malloc, calloc, realloc, posix_memalign, aligned_alloc, new.
  [[nodiscard]] std::uint64_t count() const noexcept;
  [[nodiscard]] static bool available() noexcept;

private:
  std::uint64_t begin_;
};

} // namespace bregma::test
