#include "clients/cli/registration/registration_files.hpp"

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

namespace bregma::cli {

namespace {

std::optional<casefile::Space> space_of(const std::string &option) {
  return option == "ras"   ? std::optional(casefile::Space::kRas)
         : option == "lps" ? std::optional(casefile::Space::kLps)
                           : std::nullopt;
}

// CLI11 has rejected other names.
casefile::LengthUnit unit_of(const std::string &option) {
  return casefile::unit_named(option).value_or(casefile::LengthUnit::kMillimetre);
}

} // namespace

std::optional<casefile::Space> InputFile::stated_space() const { return space_of(space); }

PointFileOptions InputFile::point_options(const casefile::SizeLimits &size) const {
  return {space_of(space), unit_of(units), size, "--" + side + "-units"};
}

casefile::SurfaceReadOptions InputFile::surface_options(const casefile::SizeLimits &size) const {
  return {.space = space_of(space), .unit = unit_of(units), .size = size, .unit_option = "--" + side + "-units"};
}

void add_input_file(CLI::App &command, InputFile &input, const std::string &name, const std::string &help) {
  command.add_option(name, input.path, help)->required();
  command.add_option("--" + input.side + "-space", input.space, "Space of a file that does not state it: ras or lps")
      ->check(CLI::IsMember({"ras", "lps"}));
  command.add_option("--" + input.side + "-units", input.units, "Unit of the file's numbers")
      ->check(CLI::IsMember({"mm", "cm", "m", "um"}))
      ->capture_default_str();
}

void add_tfm_option(CLI::App &command, RegistrationFiles &files) {
  command.add_option("--tfm", files.tfm, "Writes the transform for ITK and Slicer: LPS, resampling direction");
}

void add_registration_files(CLI::App &command, RegistrationFiles &files, const std::string &source_name,
                            const std::string &source_help, const std::string &target_name,
                            const std::string &target_help) {
  add_input_file(command, files.source, source_name, source_help);
  add_input_file(command, files.target, target_name, target_help);
  add_tfm_option(command, files);
}

} // namespace bregma::cli
