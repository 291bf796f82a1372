#include "clients/cli/report/attached_file.hpp"

#include <cstdlib>
#include <fstream>
#include <system_error>
#include <utility>

#include <unistd.h>

namespace bregma::cli::report {

base::Result<AttachedFile> AttachedFile::write(const casefile::SessionReader &reader, const std::string &name,
                                               const std::string &extension) {
  const auto body = reader.attachment(name);
  if (!body) {
    return tl::unexpected(body.error());
  }
  const std::filesystem::path folder = std::filesystem::temp_directory_path();
  std::string path = (folder / ("bregma-XXXXXX" + extension)).string();
  const int descriptor = mkstemps(path.data(), static_cast<int>(extension.size()));
  if (descriptor < 0) {
    return base::failure("cannot write a temporary file in " + folder.string());
  }
  close(descriptor);
  AttachedFile file(path);
  std::ofstream out(path, std::ios::binary);
  if (!out.write(body->data(), static_cast<std::streamsize>(body->size())).flush()) {
    return base::failure("cannot write a temporary file in " + folder.string());
  }
  return file;
}

AttachedFile::AttachedFile(AttachedFile &&other) noexcept : path_(std::exchange(other.path_, {})) {}

AttachedFile::~AttachedFile() {
  if (!path_.empty()) {
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
  }
}

} // namespace bregma::cli::report
