#include "clients/gateway/answer.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <system_error>

#include <nlohmann/json.hpp>

#include "base/read_file.hpp"

namespace bregma::gateway {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kCookie = "bregma_token";

std::shared_ptr<const std::string> text_of(std::string text) {
  return std::make_shared<const std::string>(std::move(text));
}

Answer error(int status, std::string_view sentence) {
  Answer out;
  out.status = status;
  out.body = text_of(nlohmann::json{{"error", sentence}}.dump());
  return out;
}

Answer json(std::string text) {
  Answer out;
  out.body = text_of(std::move(text));
  return out;
}

std::string lower(std::string_view text) {
  std::string out(text);
  std::transform(out.begin(), out.end(), out.begin(), [](unsigned char c) { return std::tolower(c); });
  return out;
}

// The value of a parameter of the query, or a cookie; not decoded: ours need no escapes.
std::string_view value_of(std::string_view list, std::string_view name, char separator) {
  while (!list.empty()) {
    const auto end = std::min(list.find(separator), list.size());
    std::string_view entry = list.substr(0, end);
    while (!entry.empty() && entry.front() == ' ') {
      entry.remove_prefix(1);
    }
    if (entry.size() > name.size() && entry.starts_with(name) && entry[name.size()] == '=') {
      return entry.substr(name.size() + 1);
    }
    list.remove_prefix(std::min(end + 1, list.size()));
  }
  return {};
}

bool knows_token(const Access &access, const Query &query) {
  constexpr std::string_view kBearer = "Bearer ";
  const std::string_view stated = query.authorization.starts_with(kBearer) ? query.authorization.substr(kBearer.size())
                                                                           : value_of(query.cookie, kCookie, ';');
  return access.token.empty() || same_secret(stated, access.token);
}

std::optional<Answer> refusal(const Access &access, const Query &query) {
  const std::string host = lower(query.host);
  if (std::find(access.hosts.begin(), access.hosts.end(), host) == access.hosts.end()) {
    return error(403, "this gateway is not known by that name (--host)");
  }
  const std::string own = (access.tls ? "https://" : "http://") + host;
  if (!query.origin.empty() && lower(query.origin) != own) {
    return error(403, "a page of another origin may not ask");
  }
  if (query.method != "GET" && query.method != "HEAD") {
    return error(405, "this gateway can be watched only");
  }
  return std::nullopt;
}

std::string type_of(const std::string &path) {
  constexpr std::array<std::pair<std::string_view, std::string_view>, 8> kTypes{{{".html", "text/html; charset=utf-8"},
                                                                                 {".js", "text/javascript"},
                                                                                 {".css", "text/css"},
                                                                                 {".svg", "image/svg+xml"},
                                                                                 {".png", "image/png"},
                                                                                 {".json", "application/json"},
                                                                                 {".map", "application/json"},
                                                                                 {".woff2", "font/woff2"}}};
  for (const auto &[ending, type] : kTypes) {
    if (path.ends_with(ending)) {
      return std::string(type);
    }
  }
  return "application/octet-stream";
}

Answer page_file(const Site &site, std::string_view path) {
  const auto found = site.page.find(path == "/" ? "/index.html" : std::string(path));
  if (found == site.page.end()) {
    return error(404, path == "/" ? "the page is not installed (--page)" : "there is nothing at this address");
  }
  Answer out;
  out.type = type_of(found->first);
  out.body = found->second;
  return out;
}

// "/case/HASH/image"
Answer case_file(const Sources &sources, std::string_view path) {
  constexpr std::size_t kHash = 64;
  constexpr std::string_view kPrefix = "/case/";
  path.remove_prefix(kPrefix.size());
  const std::string_view hash = path.substr(0, kHash);
  const bool hexadecimal = std::all_of(hash.begin(), hash.end(), [](unsigned char c) { return std::isxdigit(c) != 0; });
  if (path.size() <= kHash + 1 || !hexadecimal || path[kHash] != '/' || !sources.case_file) {
    return error(404, "there is nothing at this address");
  }
  const auto file = sources.case_file(hash, path.substr(kHash + 1));
  if (!file) {
    return error(404, "this case has no such file, or is not here");
  }
  Answer out;
  out.type = "application/octet-stream";
  out.body = *file;
  out.immutable = true;
  return out;
}

} // namespace

bool same_secret(std::string_view a, std::string_view b) {
  unsigned char difference = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < b.size(); ++i) {
    difference |= static_cast<unsigned char>((i < a.size() ? a[i] : '\0') ^ b[i]);
  }
  return difference == 0;
}

Access make_access(bool loopback, bool tls, std::uint16_t port, const std::vector<std::string> &hosts,
                   std::string token) {
  Access out{{}, tls, std::move(token)};
  const auto add = [&](const std::string &name) {
    out.hosts.push_back(lower(name) + ":" + std::to_string(port));
    if (port == (tls ? 443 : 80)) { // which browsers leave out
      out.hosts.push_back(lower(name));
    }
  };
  if (loopback) {
    add("localhost");
    add("127.0.0.1");
    add("[::1]");
  }
  for (const std::string &name : hosts) {
    add(name);
  }
  return out;
}

base::Result<Files> read_page(const fs::path &folder) {
  Files out;
  std::error_code failed;
  if (!fs::is_directory(folder, failed)) {
    return out;
  }
  for (auto it = fs::recursive_directory_iterator(folder, failed); !failed && it != fs::recursive_directory_iterator();
       it.increment(failed)) {
    if (it->is_regular_file(failed)) {
      auto content = base::read_file(it->path());
      if (!content) {
        return tl::unexpected(content.error());
      }
      out["/" + it->path().lexically_relative(folder).generic_string()] = text_of(std::move(*content));
    }
  }
  if (failed) {
    return base::failure(folder.string() + ": cannot be read: " + failed.message());
  }
  return out;
}

const std::vector<std::pair<std::string, std::string>> &common_headers() {
  static const std::vector<std::pair<std::string, std::string>> kHeaders{
      {"Content-Security-Policy",
       "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
       "worker-src 'self'; media-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"},
      {"X-Content-Type-Options", "nosniff"},
      {"X-Frame-Options", "DENY"},
      {"Referrer-Policy", "no-referrer"},
      {"Cross-Origin-Opener-Policy", "same-origin"},
      {"Cross-Origin-Resource-Policy", "same-origin"},
  };
  return kHeaders;
}

std::variant<Answer, Stream> answer(const Site &site, const Query &query) {
  if (auto refused = refusal(site.access, query)) {
    return *refused;
  }
  const auto mark = std::min(query.target.find('?'), query.target.size());
  const std::string_view path = query.target.substr(0, mark);
  const std::string_view parameters = query.target.substr(std::min(mark + 1, query.target.size()));
  if (!knows_token(site.access, query)) {
    const std::string_view stated = value_of(parameters, "token", '&');
    if (path != "/" || !same_secret(stated, site.access.token)) {
      return error(401, "a token is needed here: open /?token=TOKEN, or send Authorization: Bearer TOKEN");
    }
    Answer out = error(303, "see /");
    out.headers.emplace_back("Location", "/");
    out.headers.emplace_back("Set-Cookie", std::string(kCookie) + "=" + site.access.token +
                                               "; Path=/; HttpOnly; SameSite=Strict" +
                                               (site.access.tls ? "; Secure" : ""));
    return out;
  }
  if (path == "/state") {
    if (!query.upgrade) {
      return error(426, "/state is a WebSocket");
    }
    return Stream{value_of(parameters, "format", '&') == "json"};
  }
  const auto or_missing = [](const auto &source, std::string_view sentence) -> Answer {
    auto text = source ? source() : std::nullopt;
    return text ? json(std::move(*text)) : error(404, sentence);
  };
  if (path == "/case") {
    return or_missing(site.sources.case_json, "no case is loaded, or it is still on its way");
  }
  if (path.starts_with("/case/")) {
    return case_file(site.sources, path);
  }
  if (path == "/patient") {
    return or_missing(site.sources.patient,
                      "the patient is shown on the daemon's own host only, if the case names one");
  }
  if (path == "/metrics") {
    Answer out = json(site.sources.metrics ? site.sources.metrics() : std::string());
    out.type = "text/plain; version=0.0.4; charset=utf-8";
    return out;
  }
  return page_file(site, path);
}

} // namespace bregma::gateway
