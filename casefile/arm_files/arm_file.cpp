#include "casefile/arm_files/arm_file.hpp"

#include "base/read_file.hpp"
#include "base/text.hpp"

namespace bregma::casefile {

base::Result<robot::ArmModel> read_arm(const std::filesystem::path &file) {
  const std::string extension = base::lower(file.extension().string());
  if (extension != ".toml" && extension != ".urdf" && extension != ".xml") {
    return base::failure(file.string() + ": an arm is described in .toml (Denavit-Hartenberg) or .urdf");
  }
  const auto text = base::read_file(file);
  if (!text) {
    return tl::unexpected(text.error());
  }
  return extension == ".toml" ? parse_dh_arm(*text, file.string()) : parse_urdf_arm(*text, file.string());
}

} // namespace bregma::casefile
