#include "clients/cli/case/case_output.hpp"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <system_error>

#include "base/text.hpp"

namespace bregma::cli {

base::Result<void> check_output_of_case(std::string_view option, const std::string &output, const std::string &folder) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (output.empty() || !fs::exists(output, ignored)) {
    return {};
  }
  const fs::path file = fs::weakly_canonical(output, ignored);
  const std::string inside = fs::weakly_canonical(folder, ignored).string() + "/";
  // Pictures and meshes (.png, .vtu) are made there too, and may be made again.
  constexpr std::string_view kParts[] = {".toml", ".json", ".ply", ".stl", ".nii", ".gz", ".nrrd", ".mha", ".db"};
  const std::string extension = base::lower(file.extension().string());
  const bool part = std::find(std::begin(kParts), std::end(kParts), extension) != std::end(kParts);
  if (part && file.string().starts_with(inside)) {
    return base::failure(std::string(option) + " " + output + " is a file of the case: it is not written over");
  }
  return {};
}

} // namespace bregma::cli
