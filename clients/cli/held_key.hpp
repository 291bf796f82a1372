// A key of the terminal that is held down, as a deadman. A terminal reports no release, only the repetitions of a held
// key: the key counts as held from the second report on, and until 150 ms after the last one.
//
// Changes the terminal of standard input until it is destroyed. One object, one thread.
#pragma once

#include <cstdint>

#include <termios.h>

namespace bregma::cli {

// The decision, without a terminal and a clock.
class KeyRepetition {
public:
  static constexpr std::int64_t kHeld_ns = 150'000'000;       // between two reports of a held key
  static constexpr std::int64_t kFirstPause_ns = 900'000'000; // before the first repetition

  void pressed(std::int64_t now_ns);
  [[nodiscard]] bool held(std::int64_t now_ns) const;

private:
  bool repeats_ = false;
  std::int64_t last_ns_ = -kFirstPause_ns;
};

class HeldKey {
public:
  // False if standard input is no terminal.
  [[nodiscard]] static bool available();
  HeldKey();
  ~HeldKey();
  HeldKey(const HeldKey &) = delete;
  HeldKey &operator=(const HeldKey &) = delete;

  [[nodiscard]] bool held(std::int64_t now_ns);
  [[nodiscard]] bool interrupted() const { return interrupted_; } // Ctrl-C or Escape

private:
  termios before_{};
  KeyRepetition key_;
  bool interrupted_ = false;
};

} // namespace bregma::cli
