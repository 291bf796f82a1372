#include "clients/cli/command_reply.hpp"

#include <cmath>
#include <cstdio>

#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/wire_labels.hpp"

namespace bregma::cli {

int show_reply(const base::Result<wire::CommandReply> &reply, const Context &context) {
  if (!reply) {
    return fail(reply.error());
  }
  const bool done = reply->result == bregma_wire_COMMAND_DONE;
  const bool from_a_session = reply->session != bregma_wire_SESSION_UNKNOWN; // devices have none
  if (context.json) {
    print_json({{"result", result_label(reply->result)},
                {"session", from_a_session ? nlohmann::json(session_label(reply->session)) : nlohmann::json()},
                {"value_mm", json_number(reply->value_mm)},
                {"text", reply->text}});
  } else if (done) {
    const std::string text = *reply->text == '\0' ? "done" : printable(reply->text);
    print(text + (from_a_session ? " (session: " + std::string(session_label(reply->session)) + ")" : "") + "\n");
  } else {
    (void)fail(std::string(result_label(reply->result)) + ": " + printable(reply->text));
  }
  return done ? kOk : kRefused;
}

int send_and_show(const base::Result<wire::Command> &command, const Context &context,
                  live::DaemonLink::Duration timeout) {
  if (!command) {
    return fail(command.error());
  }
  live::DaemonLink link(context.domain, live::DaemonLink::Role::kCommands, context.wait_s);
  return show_reply(link.send(*command, timeout), context);
}

} // namespace bregma::cli
