// Counts the calling thread's heap allocations, so that a test can show that a loop step makes none.
//
// Link tests/support/allocation_counter.cpp into the test program: it stands in for malloc and its family (glibc).
// Under address and thread sanitizers, which do the same, it counts nothing and available() is false.
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
