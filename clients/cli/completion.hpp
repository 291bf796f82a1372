// Completion scripts generated from the program's own commands and options, so that they are always up to date.
#pragma once

#include <string>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

[[nodiscard]] std::string bash_completion(const CLI::App &program);
[[nodiscard]] std::string zsh_completion(const CLI::App &program);

// `completion bash|zsh`. The program must outlive the context's run.
void add_completion_command(CLI::App &app, Context &context);

} // namespace bregma::cli
