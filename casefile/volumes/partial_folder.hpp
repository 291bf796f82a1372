// A case folder that comes to be whole or not at all: it is filled beside its place under a hidden name, then renamed.
#pragma once

#include <filesystem>

#include "base/result.hpp"

namespace bregma::casefile {

class PartialFolder {
public:
  // Makes the hidden folder. Refuses a place that is taken, unless by a case that may be replaced.
  [[nodiscard]] static base::Result<PartialFolder> beside(const std::filesystem::path &folder, bool replace);
  ~PartialFolder(); // takes away what was not put in place
  PartialFolder(PartialFolder &&other) noexcept;
  PartialFolder &operator=(PartialFolder &&) = delete;
  PartialFolder(const PartialFolder &) = delete;
  PartialFolder &operator=(const PartialFolder &) = delete;

  [[nodiscard]] const std::filesystem::path &path() const { return path_; }
  [[nodiscard]] const std::filesystem::path &final_path() const { return final_path_; }

  // The sessions/ of a case that is replaced are taken over.
  [[nodiscard]] base::Result<void> put_in_place();

private:
  explicit PartialFolder(std::filesystem::path final_path);
  std::filesystem::path final_path_;
  std::filesystem::path path_;
};

} // namespace bregma::casefile
