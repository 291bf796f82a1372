// The version of the wire and its announcement by participants (docs/wire.md). Programs of one generation are
// compatible; a later revision only adds.
#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "streams.h"

namespace bregma::wire {

struct WireVersion {
  std::uint32_t generation = 0;
  std::uint32_t revision = 0;
  friend constexpr auto operator<=>(const WireVersion &, const WireVersion &) = default;
};
inline constexpr WireVersion kWireVersion{bregma_wire_WIRE_GENERATION, bregma_wire_WIRE_REVISION};

[[nodiscard]] std::string text_of(const WireVersion &version); // "2.0"
[[nodiscard]] std::optional<WireVersion> version_from(std::string_view text);

// A participant's USER_DATA: "bregma.wire=2.0;program=bregmad".
struct Announcement {
  WireVersion version = kWireVersion;
  std::string program;
};
[[nodiscard]] std::string to_user_data(const Announcement &announcement);
// Empty if the text is not an announcement: another vendor's program, or a release before wire 2.0.
[[nodiscard]] std::optional<Announcement> from_user_data(std::string_view data);

// The program's own announcement: this wire version and the name of its file.
[[nodiscard]] Announcement own_announcement();

} // namespace bregma::wire
