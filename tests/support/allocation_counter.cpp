#include "tests/support/allocation_counter.hpp"

#include <cerrno>
#include <cstddef>
#include <cstdlib>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define BREGMA_SANITIZED 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define BREGMA_SANITIZED 1
#endif

namespace {
// Initial-exec: the first use of the default model could itself allocate.
[[gnu::tls_model("initial-exec")]] thread_local std::uint64_t allocations = 0;
} // namespace

namespace bregma::test {

AllocationScope::AllocationScope() noexcept : begin_(allocations) {}
std::uint64_t AllocationScope::count() const noexcept { return allocations - begin_; }

#ifdef BREGMA_SANITIZED
bool AllocationScope::available() noexcept { return false; }
#else
bool AllocationScope::available() noexcept { return true; }
#endif

} // namespace bregma::test

#ifndef BREGMA_SANITIZED
// glibc's entry points under their documented names. The C++ operators call them as well.
// NOLINTBEGIN(bugprone-reserved-identifier,readability-identifier-naming)
extern "C" {
void *__libc_malloc(std::size_t size);
void *__libc_calloc(std::size_t count, std::size_t size);
void *__libc_realloc(void *old, std::size_t size);
void *__libc_memalign(std::size_t alignment, std::size_t size);

void *malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}

void *calloc(std::size_t count, std::size_t size) {
  ++allocations;
  return __libc_calloc(count, size);
}

void *realloc(void *old, std::size_t size) {
  ++allocations;
  return __libc_realloc(old, size);
}

void *memalign(std::size_t alignment, std::size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}

void *aligned_alloc(std::size_t alignment, std::size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}

int posix_memalign(void **out, std::size_t alignment, std::size_t size) {
  if (alignment % sizeof(void *) != 0 || (alignment & (alignment - 1)) != 0 || alignment == 0) {
    return EINVAL;
  }
  ++allocations;
  void *block = __libc_memalign(alignment, size);
  if (block == nullptr) {
    return ENOMEM;
  }
  *out = block;
  return 0;
}
}
// NOLINTEND(bugprone-reserved-identifier,readability-identifier-naming)
#endif
