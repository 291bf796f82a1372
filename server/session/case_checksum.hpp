// Checksum of a case's content, as the session uses it: points, trajectories, surfaces, tools and limits, bit for bit.
// A session may be restored only onto the content with which it was made. The image itself is not part of it: the
// daemon does not read it. Threads: any. Takes milliseconds for a case of 100,000 vertices.
#pragma once

#include <string>

#include "casefile/case.hpp"

namespace bregma::server {

// CRC-32 as eight hexadecimal digits. The folder's path is not part of it: a drive may be mounted elsewhere.
[[nodiscard]] std::string case_checksum(const casefile::Case &a_case);

} // namespace bregma::server
