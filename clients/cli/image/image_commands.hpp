// `bregma image register | profile | features`; one source file per command.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_image_register(CLI::App &parent, Context &context);
void add_image_profile(CLI::App &parent, Context &context);
void add_image_features(CLI::App &parent, Context &context);

} // namespace bregma::cli
