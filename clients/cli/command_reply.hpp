// How the answer to a command is shown: the same for every command that asks the daemon for something.
#pragma once

#include "clients/cli/commands.hpp"
#include "clients/cli/daemon_link.hpp"

namespace bregma::cli {

// kOk when it was done, kRefused when the daemon refused it (its reason goes to standard error), kBadInput when no
// answer came.
int show_reply(const base::Result<wire::CommandReply> &reply, const Context &context);

// Joins the domain, sends, shows. The error of a command that could not be made is shown as well.
int send_and_show(const base::Result<wire::Command> &command, const Context &context,
                  DaemonLink::Duration timeout = std::chrono::seconds(5));

} // namespace bregma::cli
