// What the registrations of files have in common on the command line: two files with their spaces and units, and where
// the result goes.
#pragma once

#include <string>

#include "casefile/surface_files/surface_file.hpp"
#include "clients/cli/registration/point_file.hpp"

namespace CLI {
class App;
}

namespace bregma::cli {

// One of the two sides; its options are --source-space and --source-units, or the same of the target.
struct InputFile {
  std::string path;
  std::string space; // "", "ras" or "lps": for a file that does not say
  std::string units = "mm";
  std::string side; // "source" or "target"

  [[nodiscard]] PointFileOptions point_options(const casefile::SizeLimits &size = casefile::kPointsSize) const;
  [[nodiscard]] casefile::SurfaceReadOptions
  surface_options(const casefile::SizeLimits &size = casefile::kHeadSize) const;
};

struct RegistrationFiles {
  InputFile source, target;
  std::string tfm; // empty: none is written

  RegistrationFiles() {
    source.side = "source";
    target.side = "target";
  }
};

// The two positional arguments and the options above. source_name, target_name: as the help shows them.
void add_registration_files(CLI::App &command, RegistrationFiles &files, const std::string &source_name,
                            const std::string &source_help, const std::string &target_name,
                            const std::string &target_help);

} // namespace bregma::cli
