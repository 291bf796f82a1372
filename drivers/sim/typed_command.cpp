#include "drivers/sim/typed_command.hpp"

#include <algorithm>
#include <iterator>

namespace bregma::sim {
namespace {

struct Words {
  wire::CommandKind kind;
  const char *text; // $0, $1: values
};

constexpr Words kWords[] = {
    {bregma_wire_COMMAND_LOAD_CASE, "case load $0"},
    {bregma_wire_COMMAND_START_PIVOT, "calibrate pivot --live $0 start"},
    {bregma_wire_COMMAND_FINISH_PIVOT, "calibrate pivot --live $0 finish"},
    {bregma_wire_COMMAND_START_REGISTRATION, "register start"},
    {bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "register capture $1 --tool $0"},
    {bregma_wire_COMMAND_START_TRACE, "register trace start --tool $0"},
    {bregma_wire_COMMAND_STOP_TRACE, "register trace stop --tool $0"},
    {bregma_wire_COMMAND_ACCEPT_REGISTRATION, "register accept"},
    {bregma_wire_COMMAND_CHECK_TOUCH, "register check $1 --tool $0"},
    {bregma_wire_COMMAND_CONFIRM_VERIFICATION, "register confirm"},
    {bregma_wire_COMMAND_START_NAVIGATION, "target navigate $0 $1"},
    {bregma_wire_COMMAND_STOP_NAVIGATION, "target stop"},
    {bregma_wire_COMMAND_CLOSE_CASE, "case close"},
};

// As a shell takes it.
std::string quoted(const std::string &word) {
  return word.find_first_of(" \t'\\$&;()*?") == std::string::npos && !word.empty() ? word : "\"" + word + "\"";
}

} // namespace

std::string typed_command(wire::CommandKind kind, const std::vector<std::string> &values) {
  const auto *const words =
      std::find_if(std::begin(kWords), std::end(kWords), [kind](const Words &w) { return w.kind == kind; });
  std::string out = words == std::end(kWords) ? std::string("(another command)") : std::string("bregma ") + words->text;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::string place = "$" + std::to_string(i);
    if (const auto at = out.find(place); at != std::string::npos) {
      out.replace(at, place.size(), quoted(values[i]));
    }
  }
  return out;
}

} // namespace bregma::sim
