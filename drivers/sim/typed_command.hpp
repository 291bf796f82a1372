// How a person gives a command of the simulated operator: the words of the program bregma.
#pragma once

#include <string>
#include <vector>

#include "idl/topics.hpp"

namespace bregma::sim {

// values: as wire::fill_command takes them. Of the commands of a scenario's steps.
[[nodiscard]] std::string typed_command(wire::CommandKind kind, const std::vector<std::string> &values);

} // namespace bregma::sim
