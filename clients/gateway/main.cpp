// bregma-gateway: reads its options, then serves until it receives a signal to stop.
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <iostream>
#include <string>
#include <system_error>

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>

#include "base/read_file.hpp"
#include "base/standard_output.hpp"
#include "clients/gateway/gateway.hpp"
#include "clients/gateway/layout.hpp"

namespace {

using namespace bregma;

constexpr int kBadInput = 2;
constexpr std::size_t kMaxTokenFile = 4096;

int fail(const base::Error &error) {
  std::fprintf(stderr, "bregma-gateway: %s\n", error.message.c_str());
  return kBadInput;
}

base::Result<std::string> read_token(const std::string &file) {
  auto text = base::read_file(file, kMaxTokenFile);
  if (!text) {
    return text;
  }
  text->erase(text->find_last_not_of(" \r\n\t") + 1);
  if (text->find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~+/=") !=
      std::string::npos) {
    return base::failure(file + ": a token is one line of letters, digits and -._~+/=");
  }
  return text;
}

// Next to the program as it is installed.
std::filesystem::path installed_page() {
  std::error_code failed;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", failed);
  return failed ? std::filesystem::path() : program.parent_path().parent_path() / "share/bregma/display";
}

std::filesystem::path user_cache() {
  const char *stated = std::getenv("XDG_CACHE_HOME");
  const char *home = std::getenv("HOME");
  const auto base = stated != nullptr && *stated == '/' ? std::filesystem::path(stated)
                    : home != nullptr && *home == '/'   ? std::filesystem::path(home) / ".cache"
                                                        : std::filesystem::temp_directory_path();
  return base / "bregma-gateway";
}

int serve(int argc, char **argv) {
  CLI::App app("bregma-gateway, the state of bregmad for browsers of this host", "bregma-gateway");
  app.set_version_flag("--version", "bregma-gateway " BREGMA_VERSION " (" BREGMA_BUILD ")");
  gateway::Config config;
  config.page = installed_page();
  config.cache = user_cache();
  std::string token_file;
  bool print_layout = false;
  app.add_option("--domain", config.domain, "DDS domain of the daemon")
      ->envname("BREGMA_DOMAIN")
      ->check(CLI::Range(0, 230))
      ->capture_default_str();
  app.add_option("--listen", config.listen.address,
                 "Address to listen on; others than loopback need --certificate, --key, --token-file and --host")
      ->capture_default_str();
  app.add_option("--port", config.listen.port, "TCP port; 0: a free one, which is printed")->capture_default_str();
  app.add_option("--host", config.hosts, "Name under which browsers ask for this gateway; may be repeated");
  app.add_option("--certificate", config.listen.certificate, "TLS: certificate chain of the site, PEM")
      ->check(CLI::ExistingFile);
  app.add_option("--key", config.listen.key, "TLS: its key, PEM")->check(CLI::ExistingFile);
  app.add_option("--token-file", token_file, "File with the token that a viewer needs")->check(CLI::ExistingFile);
  app.add_option("--page", config.page, "Folder with the page's files (default: as installed with this program)");
  app.add_option("--cache", config.cache,
                 "Folder for the files of cases, which are fetched from the daemon's host\n"
                 "(default: bregma-gateway in $XDG_CACHE_HOME or ~/.cache)");
  app.add_flag("--print-layout", print_layout, "Print the layout of the records of /state as Markdown, and end");
  app.footer("Examples:\n"
             "  bregma-gateway\n"
             "  bregma-gateway --domain 7 --port 9000\n"
             "  bregma-gateway --listen 0.0.0.0 --host display-3.or.example --certificate site.pem --key site.key "
             "--token-file token\n"
             "Exit codes: 0 ended by a signal; 2 it could not run.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return base::end_output("bregma-gateway", app.exit(error) == 0 ? 0 : kBadInput);
  }
  if (print_layout) {
    std::cout << gateway::layout_markdown();
    return base::end_output("bregma-gateway", 0);
  }
  if (!token_file.empty()) {
    auto token = read_token(token_file);
    if (!token) {
      return fail(token.error());
    }
    config.token = std::move(*token);
  }
  boost::asio::io_context io(1);
  boost::asio::signal_set signals(io, SIGINT, SIGTERM);
  signals.async_wait([&io](const auto &, int) { io.stop(); });
  auto running = gateway::Gateway::open(io, config);
  if (!running) {
    return fail(running.error());
  }
  const bool tls = !config.listen.certificate.empty();
  const std::string host = config.hosts.empty() ? "localhost" : config.hosts.front();
  std::printf("http%s://%s:%u/\n", tls ? "s" : "", host.c_str(), static_cast<unsigned>((*running)->port()));
  std::fflush(stdout);
  io.run();
  return 0;
}

} // namespace

int main(int argc, char **argv) {
  try {
    return serve(argc, argv);
  } catch (const std::exception &error) {
    return fail({error.what()});
  }
}
