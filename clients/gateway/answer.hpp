// What a request is answered: who may ask, and what there is. No sockets, so that tests and the fuzzer call it
// directly.
//
// Threads: those of the site, which is the gateway's one.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "base/result.hpp"

namespace bregma::gateway {

// The part of a request that is looked at. Empty: the header is missing.
struct Query {
  std::string_view method;
  std::string_view target; // path and, after '?', parameters
  std::string_view host;
  std::string_view origin;
  std::string_view authorization;
  std::string_view cookie;
  bool upgrade = false; // to a WebSocket
};

struct Answer {
  int status = 200;
  std::string type = "application/json";
  std::variant<std::shared_ptr<const std::string>, std::filesystem::path> body; // a path: the whole file
  bool immutable = false;                                                       // may be cached for ever
  std::vector<std::pair<std::string, std::string>> headers;
};

// Of /state; the socket is to be upgraded.
struct Stream {
  bool json = false;
};

// Names under which the gateway may be asked, and the secret. A page of another site that has its own name resolve to
// this host sends its own Host, and a page of another origin its own Origin.
struct Access {
  std::vector<std::string> hosts; // with port, lower case: "localhost:8310"
  bool tls = false;
  std::string token; // empty: none is needed
};
// hosts: additional names without port. For loopback, localhost and its addresses are always allowed.
[[nodiscard]] Access make_access(bool loopback, bool tls, std::uint16_t port, const std::vector<std::string> &hosts,
                                 std::string token);

// The page's files by path ("/index.html"), read once: nothing that a request says becomes a path on disk.
using Files = std::map<std::string, std::shared_ptr<const std::string>>;
// A folder that does not exist is an empty list; a file that cannot be read is an error.
[[nodiscard]] base::Result<Files> read_page(const std::filesystem::path &folder);

// Where the answers come from. All may be empty functions.
struct Sources {
  std::function<std::optional<std::string>()> case_json;
  // A file of the case with this hash: "image", "labels" or "mesh/NAME".
  std::function<std::optional<std::filesystem::path>(std::string_view hash, std::string_view name)> case_file;
  std::function<std::optional<std::string>()> patient;
  std::function<std::string()> metrics;
};

struct Site {
  Access access;
  Files page;
  Sources sources;
};

[[nodiscard]] std::variant<Answer, Stream> answer(const Site &site, const Query &query);

// Answers every response has: what the page may load, and what others may do with it.
[[nodiscard]] const std::vector<std::pair<std::string, std::string>> &common_headers();

// Takes the same time for every text of the secret's length.
[[nodiscard]] bool same_secret(std::string_view a, std::string_view b);

} // namespace bregma::gateway
