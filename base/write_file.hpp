// Writing of a whole file for users: it is complete, or as it was before.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "base/result.hpp"

namespace bregma::base {

// Writes "<file>.new" next to it and renames that, so that a full disk costs no earlier content. What exists and is not
// a regular file (/dev/stdout, a pipe) is written to directly. Every error names the file and the reason. It does not
// wait until the content is on the disk.
[[nodiscard]] Result<void> write_file(const std::filesystem::path &file, std::string_view content);

// The reason of a failed write: "the disk is full" where it is, else the system's text.
[[nodiscard]] std::string write_problem(int error_number);

} // namespace bregma::base
