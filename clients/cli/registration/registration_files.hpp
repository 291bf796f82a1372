// Common command-line options of registrations of files: two files with their spaces and units, and the output.
#pragma once

#include <string>

#include "casefile/surface_files/surface_file.hpp"
#include "clients/cli/registration/point_file.hpp"

namespace CLI {
class App;
}

namespace bregma::cli {

// One of the two sides, with the options --source-space and --source-units, or those of the target.
struct InputFile {
  std::string path;
  std::string space; // "", "ras" or "lps": for a file that does not state its space
  std::string units = "mm";
  std::string side; // "source" or "target"

  [[nodiscard]] std::optional<casefile::Space> stated_space() const;
  [[nodiscard]] PointFileOptions point_options(const casefile::SizeLimits &size = casefile::kPointsSize) const;
  [[nodiscard]] casefile::SurfaceReadOptions
  surface_options(const casefile::SizeLimits &size = casefile::kHeadSize) const;
};

struct RegistrationFiles {
  InputFile source, target;
  std::string tfm; // empty: no file is written

  RegistrationFiles() {
    source.side = "source";
    target.side = "target";
  }
};

// One positional argument with the options of its side; --tfm.
void add_input_file(CLI::App &command, InputFile &input, const std::string &name, const std::string &help);
void add_tfm_option(CLI::App &command, RegistrationFiles &files);

// The two positional arguments and the options above. source_name, target_name: names in the help text.
void add_registration_files(CLI::App &command, RegistrationFiles &files, const std::string &source_name,
                            const std::string &source_help, const std::string &target_name,
                            const std::string &target_help);

} // namespace bregma::cli
