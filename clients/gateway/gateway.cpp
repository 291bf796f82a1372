#include "clients/gateway/gateway.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <iterator>
#include <optional>
#include <string_view>
#include <utility>

#include <nlohmann/json.hpp>

#include "base/read_file.hpp"
#include "clients/gateway/encode.hpp"
#include "clients/live/daemon_link.hpp"
#include "idl/boot_clock.hpp"
#include "idl/names.hpp"

namespace bregma::gateway {
namespace {

using namespace std::chrono_literals;

constexpr auto kUpdate = 20ms;    // at most, until the end of a pose is noticed without new samples
constexpr auto kSiblings = 150us; // after a sample, until one of the same frame has followed
constexpr std::int64_t kMaxSiblings_ns = 600'000;
constexpr auto kTick = 1s;
constexpr std::size_t kMinToken = 16;
constexpr std::size_t kMaxPatientBytes = 4096;

} // namespace

base::Result<void> check(const Config &config) {
  if (config.listen.certificate.empty() != config.listen.key.empty()) {
    return base::failure("--certificate and --key are needed together");
  }
  if (is_loopback(config.listen.address)) {
    return {};
  }
  if (config.listen.certificate.empty()) {
    return base::failure("--listen " + config.listen.address +
                         ": outside loopback TLS is needed: give --certificate and --key");
  }
  if (config.token.size() < kMinToken) {
    return base::failure("--listen " + config.listen.address + ": outside loopback a token of at least " +
                         std::to_string(kMinToken) + " characters is needed: give --token-file");
  }
  if (config.hosts.empty()) {
    return base::failure("--listen " + config.listen.address +
                         ": give the name under which browsers ask for it: --host NAME");
  }
  return {};
}

Gateway::Gateway(boost::asio::io_context &io) : timer_(io) {}

base::Result<std::unique_ptr<Gateway>> Gateway::open(boost::asio::io_context &io, const Config &config) {
  if (auto good = check(config); !good) {
    return tl::unexpected(good.error());
  }
  auto page = read_page(config.page);
  if (!page) {
    return tl::unexpected(page.error());
  }
  std::unique_ptr<Gateway> out(new Gateway(io));
  out->shared_->site.page = std::move(*page);
  auto server = Server::open(io, out->shared_, config.listen);
  if (!server) {
    return tl::unexpected(server.error());
  }
  out->server_ = std::move(*server);
  out->shared_->site.access = make_access(is_loopback(config.listen.address), !config.listen.certificate.empty(),
                                          out->port(), config.hosts, config.token);
  out->shared_->site.sources.metrics = [gateway = out.get()] {
    return gateway->shared_->metrics.text(gateway->shared_->store);
  };
  out->link_ = std::make_unique<live::DaemonLink>(config.domain, live::DaemonLink::Role::kDisplay);
  if (!config.cache.empty()) {
    auto folder = casefiles::CaseFetcher::make_folder(config.cache);
    if (!folder) {
      return tl::unexpected(folder.error());
    }
    out->cases_ = std::make_unique<casefiles::CaseFetcher>(out->link_->participant(), *folder);
    out->serve_case();
  }
  if (is_loopback(config.listen.address)) {
    out->serve_patient();
  }
  out->thread_ = std::thread([gateway = out.get()] { gateway->read_dds(); });
  out->tick();
  return out;
}

Gateway::~Gateway() {
  stopping_ = true;
  if (thread_.joinable()) {
    thread_.join();
  }
  cases_.reset(); // it uses the participant of link_
}

void Gateway::read_dds() {
  Encoder encoder(shared_->store);
  while (!stopping_) {
    link_->want_field(field_wanted_);
    link_->want_slices(slices_wanted_);
    if (link_->update(kUpdate)) {
      await_siblings();
    }
    follow_case_folder();
    (void)encoder.encode(link_->snapshot(), live::Now::read());
    (void)encode_case();
    server_->news(); // also without any: what has waited for a tool is sent after a while
  }
}

// The daemon writes the states of a tracker's frame one after another. Sent with the first one, the others would wait
// for the next frame of each client.
void Gateway::await_siblings() {
  const std::int64_t end_ns = wire::boot_now_ns() + kMaxSiblings_ns;
  while (wire::boot_now_ns() < end_ns && link_->update(kSiblings)) {
  }
}

void Gateway::serve_case() {
  auto &sources = shared_->site.sources;
  sources.case_json = [this] { return cases_->json(); };
  sources.case_file = [this](std::string_view hash, std::string_view name) { return cases_->file(hash, name); };
}

// The file beside the case (casefile/volumes/patient.hpp). A daemon of another host has no folder here.
void Gateway::serve_patient() {
  shared_->site.sources.patient = [this]() -> std::optional<std::string> {
    std::string folder;
    {
      const std::lock_guard lock(mutex_);
      folder = case_folder_;
    }
    if (folder.empty()) {
      return std::nullopt;
    }
    const auto text = base::read_file(std::filesystem::path(folder) / "patient.json", kMaxPatientBytes);
    const auto json = text ? nlohmann::json::parse(*text, nullptr, false) : nlohmann::json();
    if (!json.is_object()) {
      return std::nullopt;
    }
    nlohmann::json out;
    for (const char *field : {"name", "id", "birth_date"}) {
      out[field] = json.contains(field) && json[field].is_string() ? json[field] : nlohmann::json("");
    }
    return out.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  };
}

void Gateway::follow_case_folder() {
  static const auto kOwnBoot = wire::boot_id();
  const auto &health = link_->snapshot().health;
  const bool here = health && std::equal(kOwnBoot.begin(), kOwnBoot.end(), std::begin(health->boot_id));
  const std::lock_guard lock(mutex_);
  case_folder_ =
      here ? std::string(health->case_folder, strnlen(health->case_folder, sizeof health->case_folder)) : std::string();
}

// Without a case server's word, the daemon's health states whether a case is loaded.
bool Gateway::encode_case() {
  using State = casefiles::CaseStatus::State;
  const auto &health = link_->snapshot().health;
  casefiles::CaseStatus status;
  if (cases_) {
    if (health) {
      cases_->follow(health->boot_id);
    }
    status = cases_->status();
  }
  if (status.state == State::kNoServer && (!health || health->case_folder[0] == '\0')) {
    status.state = State::kNone;
  }
  CaseProgress progress{};
  progress.fraction = std::floor(status.fraction * 100.0) / 100.0;
  progress.state = static_cast<std::uint32_t>(status.state);
  status.hash.copy(progress.hash, sizeof progress.hash);
  wire::set_text(progress.id, status.id);
  wire::set_text(progress.text, status.state == State::kNoServer
                                    ? "the case is loaded, but no bregma-case-server answers on the daemon's host"
                                    : status.text);
  constexpr std::array kKinds{RecordKind::kCase};
  return shared_->store.replace(kKinds, {make_record(RecordKind::kCase, progress)});
}

void Gateway::tick() {
  server_->tidy();
  const auto &watchers = shared_->watchers;
  field_wanted_ = std::any_of(watchers.begin(), watchers.end(), [](const auto *one) { return one->wants_field(); });
  slices_wanted_ = std::any_of(watchers.begin(), watchers.end(), [](const auto *one) { return one->wants_slices(); });
  timer_.expires_after(kTick);
  timer_.async_wait([this](const boost::system::error_code &failed) {
    if (!failed) {
      tick();
    }
  });
}

} // namespace bregma::gateway
