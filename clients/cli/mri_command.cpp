// `bregma mri`: distortion of the scanner, and the registration of the robot to it.
#include <CLI/App.hpp>

#include "clients/cli/commands.hpp"
#include "clients/cli/mri/mri_commands.hpp"
#include "clients/cli/mri/report/report_command.hpp"

namespace bregma::cli {

void add_mri_command(CLI::App &app, Context &context) {
  auto *mri = app.add_subcommand("mri", "Works with an MR scanner");
  mri->require_subcommand(1);
  add_mri_points(*mri, context);
  add_mri_field(*mri, context);
  add_mri_correct(*mri, context);
  add_mri_register(*mri, context);
  add_mri_step(*mri, context);
  add_mri_acquire(*mri, context);
  add_mri_report(*mri, context);
}

} // namespace bregma::cli
