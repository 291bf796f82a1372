// Names that samples carried, but that the configuration or the case does not know. The newest replaces the one that
// was silent for longest, so a flood of names cannot fill the table. One thread; copied in StreamHealth.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "idl/names.hpp"

namespace bregma::inputs {

class UnknownNames {
public:
  struct Entry {
    wire::Name name = {}; // empty: unused
    std::int64_t last_ns = 0;
  };
  static constexpr std::size_t kKept = 8;

  void add(const wire::Name &name, std::int64_t now_ns) noexcept {
    if (name[0] == '\0' || !wire::is_terminated(name)) {
      return;
    }
    Entry *entry = std::find_if(entries_.begin(), entries_.end(),
                                [&](const Entry &known) { return wire::view(known.name) == wire::view(name); });
    if (entry == entries_.end()) {
      entry = std::min_element(entries_.begin(), entries_.end(),
                               [](const Entry &a, const Entry &b) { return a.last_ns < b.last_ns; });
      std::copy_n(name, sizeof(wire::Name), entry->name);
    }
    entry->last_ns = now_ns;
  }
  void add(const UnknownNames &others) noexcept {
    for (const Entry &entry : others.entries_) {
      add(entry.name, entry.last_ns);
    }
  }
  [[nodiscard]] const std::array<Entry, kKept> &entries() const noexcept { return entries_; }

private:
  std::array<Entry, kKept> entries_{};
};

} // namespace bregma::inputs
