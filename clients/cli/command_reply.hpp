// Output of the daemon's reply, the same for every command.
#pragma once

#include "clients/cli/commands.hpp"
#include "clients/live/daemon_link.hpp"

namespace bregma::cli {

// kOk when done, kRefused when the daemon refused (with its reason on standard error), kBadInput without a reply.
int show_reply(const base::Result<wire::CommandReply> &reply, const Context &context);

// Joins the domain, sends, shows. The error of a command that could not be made is shown as well.
int send_and_show(const base::Result<wire::Command> &command, const Context &context,
                  live::DaemonLink::Duration timeout = std::chrono::seconds(5));

} // namespace bregma::cli
