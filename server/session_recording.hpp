// What a session file begins with: its name, the case as it was, and who recorded it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "casefile/case.hpp"
#include "casefile/session_file/session_file.hpp"

namespace bregma::server {

// sessions/<UTC time>.db in the case's folder; a number is added where such a file exists.
[[nodiscard]] std::filesystem::path new_session_file(const casefile::Case &a_case, std::int64_t now_ns);

// Every plan and surface of the case's folder under its file name, and the configuration as bregmad.toml, so that a
// report needs nothing but the session file. The image stays where it is.
[[nodiscard]] std::vector<casefile::Attachment> attachments_of(const casefile::Case &a_case,
                                                               const std::string &config_toml);
[[nodiscard]] std::vector<casefile::MetaEntry> meta_of(const casefile::Case &a_case, std::int64_t now_ns);

} // namespace bregma::server
