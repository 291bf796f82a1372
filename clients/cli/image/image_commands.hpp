// `bregma image register | profile | features | add | list | remove`.
#pragma once

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_image_register(CLI::App &parent, Context &context);
void add_image_profile(CLI::App &parent, Context &context);
void add_image_features(CLI::App &parent, Context &context);
void add_image_add(CLI::App &parent, Context &context);
void add_image_list(CLI::App &parent, Context &context);
void add_image_remove(CLI::App &parent, Context &context);

} // namespace bregma::cli
