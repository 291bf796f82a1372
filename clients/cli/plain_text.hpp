// Text fragments that several commands print.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "casefile/session_file/growth.hpp"

namespace bregma::cli {

// "850 ms", "12.3 s", "5 min 2 s", "3 h 20 min"; "-" if unknown.
[[nodiscard]] std::string duration_text(double seconds);

// "86.4 GB free: 10.0 hours of recording at 2.4 MB/s".
[[nodiscard]] std::string space_text(const casefile::RecordingSpace &space);

// Replaces control characters and invalid UTF-8 in names and texts from the wire or a file by "?": they must not
// control a terminal.
[[nodiscard]] std::string printable(std::string_view text);

// Lines of at most this many columns: a longer one continues on the next line, indented, from its last space that fits.
[[nodiscard]] std::string wrapped(std::string_view text, std::size_t columns);

} // namespace bregma::cli
