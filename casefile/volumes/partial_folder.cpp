#include "casefile/volumes/partial_folder.hpp"

#include <unistd.h>

#include <string>
#include <system_error>
#include <utility>

namespace bregma::casefile {

namespace fs = std::filesystem;

namespace {

base::Result<void> check_place(const fs::path &folder, bool replace) {
  std::error_code error;
  const bool is_folder = fs::is_directory(folder, error);
  if (!fs::exists(folder, error) || (is_folder && fs::is_empty(folder, error))) {
    return {};
  }
  if (!is_folder || !fs::exists(folder / "case.toml", error)) {
    return base::failure(folder.string() + ": exists and is not a case; it is left alone");
  }
  if (!replace) {
    return base::failure(folder.string() + ": there is a case already; --force replaces it and keeps its sessions");
  }
  return {};
}

} // namespace

PartialFolder::PartialFolder(fs::path final_path)
    : final_path_(std::move(final_path)),
      path_(final_path_.parent_path() /
            ("." + final_path_.filename().string() + ".partial-" + std::to_string(::getpid()))) {}

PartialFolder::PartialFolder(PartialFolder &&other) noexcept
    : final_path_(std::move(other.final_path_)), path_(std::exchange(other.path_, {})) {}

PartialFolder::~PartialFolder() {
  std::error_code ignored;
  if (!path_.empty()) {
    fs::remove_all(path_, ignored);
  }
}

base::Result<PartialFolder> PartialFolder::next_to(const fs::path &folder, bool replace) {
  const fs::path place = fs::absolute(folder / "").lexically_normal().parent_path(); // without a trailing slash
  if (auto free = check_place(place, replace); !free) {
    return tl::unexpected(free.error());
  }
  PartialFolder partial(place);
  std::error_code error;
  fs::create_directories(partial.path_, error);
  if (error) {
    return base::failure(partial.path_.string() + ": cannot be made: " + error.message());
  }
  return partial;
}

base::Result<void> PartialFolder::put_in_place() {
  const fs::path old = path_.string() + "-old";
  std::error_code error;
  const bool replaces = fs::exists(final_path_, error);
  if (replaces) {
    fs::rename(final_path_, old, error);
  }
  if (!error) {
    fs::rename(path_, final_path_, error);
    if (error && replaces) {
      std::error_code ignored;
      fs::rename(old, final_path_, ignored);
    }
  }
  if (error) {
    return base::failure(final_path_.string() + ": cannot be put in place: " + error.message());
  }
  path_.clear();
  if (replaces) {
    if (fs::exists(old / "sessions", error)) {
      fs::rename(old / "sessions", final_path_ / "sessions", error);
      if (error) {
        return base::failure(old.string() + ": its sessions cannot be moved to the new case: " + error.message());
      }
    }
    fs::remove_all(old, error);
  }
  return {};
}

} // namespace bregma::casefile
