// `bregma image`: comparison and registration of images by their intensities.
#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/commands.hpp"
#include "clients/cli/image/image_commands.hpp"

namespace bregma::cli {

void add_image_command(CLI::App &app, Context &context) {
  auto *command = app.add_subcommand("image", "Compares and registers images by their grey values; images of a case");
  command->require_subcommand(1);
  command->footer(
      "Examples:\n  bregma image register new_mr.nii.gz planning_ct.nii.gz --tfm mr_to_ct.tfm\n"
      "  bregma image profile mr.nii.gz ct.nii.gz --parameter rotation-z --from -60 --to 60 --plot nmi.svg\n"
      "  bregma image features mr.nii.gz --feature aig --out aig.nii.gz\n"
      "  bregma image add colin27 t2.nii.gz --result t2.json --name T2");
  add_image_register(*command, context);
  add_image_profile(*command, context);
  add_image_features(*command, context);
  add_image_add(*command, context);
  add_image_list(*command, context);
  add_image_remove(*command, context);
}

} // namespace bregma::cli
