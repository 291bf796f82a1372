// Memory of the process.
#pragma once

#include <cstdint>
#include <cstdio>

#include <unistd.h>

namespace bregma::runtime {

// Resident set size, from /proc/self/statm; 0 if it is not available. Not for loops: opens a file.
[[nodiscard]] inline std::uint64_t resident_bytes() {
  std::FILE *file = std::fopen("/proc/self/statm", "re");
  if (file == nullptr) {
    return 0;
  }
  unsigned long long total = 0;
  unsigned long long resident = 0;
  const int fields = std::fscanf(file, "%llu %llu", &total, &resident); // NOLINT(cert-err34-c): the kernel's own format
  std::fclose(file);
  return fields == 2 ? resident * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE)) : 0;
}

} // namespace bregma::runtime
