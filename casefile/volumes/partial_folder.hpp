// A case folder that is made completely or not at all: it is filled next to its place under a hidden name, then
// renamed.
#pragma once

#include <filesystem>

#include "base/result.hpp"

namespace bregma::casefile {

class PartialFolder {
public:
  // Makes the hidden folder. Refuses an existing folder, unless it is a case that may be replaced.
  [[nodiscard]] static base::Result<PartialFolder> next_to(const std::filesystem::path &folder, bool replace);
  ~PartialFolder(); // removes the folder if it was not put in place
  PartialFolder(PartialFolder &&other) noexcept;
  PartialFolder &operator=(PartialFolder &&) = delete;
  PartialFolder(const PartialFolder &) = delete;
  PartialFolder &operator=(const PartialFolder &) = delete;

  [[nodiscard]] const std::filesystem::path &path() const { return path_; }
  [[nodiscard]] const std::filesystem::path &final_path() const { return final_path_; }

  // The sessions/ of a replaced case are kept.
  [[nodiscard]] base::Result<void> put_in_place();

private:
  explicit PartialFolder(std::filesystem::path final_path);
  std::filesystem::path final_path_;
  std::filesystem::path path_;
};

} // namespace bregma::casefile
