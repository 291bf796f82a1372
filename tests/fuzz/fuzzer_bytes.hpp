// What the targets that make messages of arbitrary bytes share.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace bregma::fuzz {

// Returns the fuzzer's bytes, then zeros.
class Bytes {
public:
  Bytes(const std::uint8_t *data, std::size_t size) : data_(data), left_(size) {}
  [[nodiscard]] bool empty() const { return left_ == 0; }
  template <class T> T take() {
    T out{};
    const std::size_t size = std::min(sizeof out, left_);
    std::memcpy(static_cast<void *>(&out), data_, size);
    data_ += size;
    left_ -= size;
    return out;
  }

private:
  const std::uint8_t *data_;
  std::size_t left_;
};

inline void require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

} // namespace bregma::fuzz
