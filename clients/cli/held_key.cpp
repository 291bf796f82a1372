#include "clients/cli/held_key.hpp"

#include <unistd.h>

namespace bregma::cli {

void KeyRepetition::pressed(std::int64_t now_ns) {
  const std::int64_t since_ns = now_ns - last_ns_;
  repeats_ = repeats_ ? since_ns <= kHeld_ns : since_ns <= kFirstPause_ns;
  last_ns_ = now_ns;
}

bool KeyRepetition::held(std::int64_t now_ns) const { return repeats_ && now_ns - last_ns_ <= kHeld_ns; }

bool HeldKey::available() { return isatty(STDIN_FILENO) == 1; }

HeldKey::HeldKey() {
  (void)tcgetattr(STDIN_FILENO, &before_);
  termios raw = before_;
  raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO | ISIG);
  raw.c_cc[VMIN] = 0;
  raw.c_cc[VTIME] = 0;
  (void)tcsetattr(STDIN_FILENO, TCSANOW, &raw);
}

HeldKey::~HeldKey() { (void)tcsetattr(STDIN_FILENO, TCSAFLUSH, &before_); }

bool HeldKey::held(std::int64_t now_ns) {
  constexpr char kInterrupt = 3;
  constexpr char kEscape = 27;
  char keys[64];
  const ssize_t count = read(STDIN_FILENO, keys, sizeof keys);
  for (ssize_t i = 0; i < count; ++i) {
    interrupted_ = interrupted_ || keys[i] == kInterrupt || (keys[i] == kEscape && count == 1);
  }
  if (count > 0) {
    key_.pressed(now_ns);
  }
  return !interrupted_ && key_.held(now_ns);
}

} // namespace bregma::cli
