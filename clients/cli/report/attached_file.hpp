// An attachment of a session file for readers that take files.
#pragma once

#include <filesystem>
#include <string>

#include "base/result.hpp"
#include "casefile/session_file/session_file.hpp"

namespace bregma::cli::report {

// The attachment as a temporary file, which is removed with this object.
class AttachedFile {
public:
  // extension: of the file, ".ply".
  [[nodiscard]] static base::Result<AttachedFile> write(const casefile::SessionReader &reader, const std::string &name,
                                                        const std::string &extension);
  AttachedFile(AttachedFile &&other) noexcept;
  AttachedFile &operator=(AttachedFile &&) = delete;
  AttachedFile(const AttachedFile &) = delete;
  AttachedFile &operator=(const AttachedFile &) = delete;
  ~AttachedFile();

  [[nodiscard]] const std::filesystem::path &path() const { return path_; }

private:
  explicit AttachedFile(std::filesystem::path path) : path_(std::move(path)) {}
  std::filesystem::path path_; // empty: moved from
};

} // namespace bregma::cli::report
