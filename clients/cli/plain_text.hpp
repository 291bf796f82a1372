// Small pieces of text that several commands print.
#pragma once

#include <string>
#include <string_view>

namespace bregma::cli {

// "850 ms", "12.3 s", "5 min 2 s", "3 h 20 min"; "-" where it is not known.
[[nodiscard]] std::string duration_text(double seconds);

// Control characters, which names and texts from the wire or a file may hold, as "?": they must not steer a terminal.
[[nodiscard]] std::string printable(std::string_view text);

} // namespace bregma::cli
