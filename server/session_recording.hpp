// Initial content of a session file: its name, the case as loaded, and the recording program.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "casefile/case.hpp"
#include "casefile/session_file/session_file.hpp"

namespace bregma::server {

// sessions/<UTC time>.db in the case's folder. A number is added if the file exists.
[[nodiscard]] std::filesystem::path new_session_file(const casefile::Case &a_case, std::int64_t now_ns);

// Every plan and surface of the case's folder under its file name, and the configuration as bregmad.toml. A report then
// needs only the session file. The image is not attached.
[[nodiscard]] std::vector<casefile::Attachment> attachments_of(const casefile::Case &a_case,
                                                               const std::string &config_toml);
[[nodiscard]] std::vector<casefile::MetaEntry> meta_of(const casefile::Case &a_case, std::int64_t now_ns);

} // namespace bregma::server
