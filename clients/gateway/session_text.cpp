#include "clients/gateway/session_text.hpp"

#include "idl/version.hpp"

namespace bregma::gateway {
namespace {

std::string registration_step(const live::Snapshot &snapshot) {
  if (!snapshot.registration) {
    return "touch the fiducials, or trace the skin";
  }
  switch (snapshot.registration->status) {
  case bregma_wire_REGISTRATION_REFUSED:
    return snapshot.registration->text;
  case bregma_wire_REGISTRATION_CANDIDATE:
    return "look at the residuals, and accept the registration";
  default:
    return "touch the fiducials, or trace the skin";
  }
}

} // namespace

std::string next_step_text(const live::Snapshot &snapshot) {
  switch (snapshot.health ? snapshot.health->session : bregma_wire_SESSION_UNKNOWN) {
  case bregma_wire_SESSION_IDLE:
    return "load a case";
  case bregma_wire_SESSION_CASE_LOADED:
    return "calibrate the tips of the tools, then start the registration";
  case bregma_wire_SESSION_REGISTERING:
    return registration_step(snapshot);
  case bregma_wire_SESSION_REGISTERED:
    return "touch the check landmarks, and confirm the verification";
  case bregma_wire_SESSION_VERIFIED:
    return "start the navigation";
  case bregma_wire_SESSION_DEGRADED:
  case bregma_wire_SESSION_FAULT:
    return "look at the alarms";
  default:
    return {};
  }
}

std::string link_text(const live::Snapshot &snapshot, bool alive) {
  std::string out;
  const auto add = [&out](const std::string &text) { out += (out.empty() || text.empty() ? "" : "; ") + text; };
  if (!snapshot.health) {
    add("no bregmad has been heard");
  } else if (!alive) {
    add("bregmad is silent");
  } else if (snapshot.health->wire_generation != wire::kWireVersion.generation) {
    add("bregmad speaks another wire generation");
  }
  add(snapshot.other_wire);
  add(snapshot.other_daemons);
  add(snapshot.mismatches);
  return out;
}

} // namespace bregma::gateway
