#include "clients/casefiles/case_fetcher.hpp"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <random>
#include <system_error>
#include <utility>

#include <unistd.h>

#include "base/read_file.hpp"
#include "idl/boot_clock.hpp"
#include "idl/names.hpp"

namespace bregma::casefiles {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr auto kWait = 50ms;
constexpr std::int64_t kRetry_ns = 5'000'000'000; // after a failure
constexpr std::size_t kKnownCases = 2;            // a page may still be loading the one before

Hash hash_of(const wire::Sha256 &from) {
  Hash out;
  std::copy(std::begin(from), std::end(from), out.begin());
  return out;
}

std::string unique_name() {
  std::random_device random;
  return "gateway-" + std::to_string(getpid()) + "-" + std::to_string(random() % 1'000'000);
}

} // namespace

base::Result<fs::path> CaseFetcher::make_folder(const fs::path &folder) {
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (!failed) {
    fs::permissions(folder, fs::perms::owner_all, failed); // images of patients
  }
  if (failed) {
    return base::failure(folder.string() + ": cannot be made: " + failed.message());
  }
  return folder;
}

CaseFetcher::CaseFetcher(const dds::Participant &participant, fs::path folder)
    : folder_(std::move(folder)), client_(unique_name()), offers_(participant), requests_(participant),
      chunks_(participant), wait_(participant) {
  wait_.attach(offers_);
  wait_.attach(chunks_);
  thread_ = std::thread([this] { run(); });
}

CaseFetcher::~CaseFetcher() {
  stopping_ = true;
  thread_.join();
}

void CaseFetcher::follow(const wire::BootId &boot_id) {
  const std::lock_guard lock(mutex_);
  std::copy(std::begin(boot_id), std::end(boot_id), followed_.begin());
}

CaseStatus CaseFetcher::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

std::optional<std::string> CaseFetcher::json() const {
  const std::lock_guard lock(mutex_);
  const auto found = known_.find(status_.hash);
  return found == known_.end() ? std::nullopt : std::optional(found->second.json);
}

std::optional<fs::path> CaseFetcher::file(std::string_view case_hash, std::string_view name) const {
  const std::lock_guard lock(mutex_);
  const auto found = known_.find(case_hash);
  if (found == known_.end()) {
    return std::nullopt;
  }
  const auto &files = found->second.files;
  const auto entry = files.find(name);
  return entry == files.end() ? std::nullopt : std::optional(place_of(entry->second.hash));
}

void CaseFetcher::set(CaseStatus status) {
  const std::lock_guard lock(mutex_);
  status_ = std::move(status);
}

void CaseFetcher::run() {
  while (!stopping_) {
    (void)wait_.wait(kWait);
    const std::int64_t now_ns = wire::boot_now_ns();
    take_offers();
    take_chunks(now_ns);
    advance(now_ns);
  }
}

void CaseFetcher::take_offers() {
  offers_.take_each([&](const wire::CaseOffer &offer, const dds::SampleInfo &info) {
    const std::string server = wire::text(offer.server);
    if (info.ended) {
      offered_.erase(server);
    } else {
      offered_[server] = offer;
    }
  });
  // Its last offer is still true, but there is nobody to ask.
  if (offers_.status().writers_alive == 0 && !complete_) {
    offered_.clear();
  }
}

void CaseFetcher::take_chunks(std::int64_t now_ns) {
  chunks_.take_each([&](const wire::CaseChunk &chunk, const dds::SampleInfo &) {
    if (download_ && hash_of(chunk.file) == download_->id().hash) {
      const std::span data(reinterpret_cast<const std::byte *>(chunk.data._buffer), chunk.data._length);
      (void)download_->accept(chunk.chunk, chunk.crc32, data);
    }
  });
  (void)chunks_.status();
  if (download_ && download_->complete()) {
    const FileId id = download_->id();
    const auto finished = download_->finish();
    download_.reset();
    if (!finished) {
      return fail(finished.error().message, now_ns);
    }
    verified_[to_hex(id.hash)] = true;
    done_bytes_ += id.bytes;
  }
}

void CaseFetcher::advance(std::int64_t now_ns) {
  const wire::CaseOffer *offer = nullptr;
  {
    const std::lock_guard lock(mutex_);
    for (const auto &[server, one] : offered_) {
      if (std::equal(followed_.begin(), followed_.end(), std::begin(one.boot_id))) {
        offer = &one;
      }
    }
  }
  using State = CaseStatus::State;
  if (offer == nullptr || offer->state != bregma_wire_CASE_OFFER_READY) {
    wanted_.reset();
    download_.reset();
    complete_ = false;
    CaseStatus status;
    if (offer != nullptr) {
      status.id = wire::text(offer->case_id);
      status.text = offer->text;
      status.state = offer->state == bregma_wire_CASE_OFFER_NONE     ? State::kNone
                     : offer->state == bregma_wire_CASE_OFFER_FAILED ? State::kFailed
                                                                     : State::kOnItsWay;
    }
    return set(std::move(status));
  }
  const FileId manifest{hash_of(offer->manifest), offer->manifest_bytes};
  if (wanted_ != manifest) {
    start(*offer);
  }
  if (!complete_ && now_ns >= retry_ns_) {
    download_next(now_ns);
  }
}

void CaseFetcher::start(const wire::CaseOffer &offer) {
  wanted_ = FileId{hash_of(offer.manifest), offer.manifest_bytes};
  manifest_.reset();
  missing_.clear();
  download_.reset();
  complete_ = false;
  total_bytes_ = done_bytes_ = 0;
  retry_ns_ = 0;
  set({CaseStatus::State::kOnItsWay, 0.0, {}, wire::text(offer.case_id), {}});
}

bool CaseFetcher::is_here(const FileId &id) {
  const std::string name = to_hex(id.hash);
  if (!verified_.contains(name)) {
    std::error_code missing;
    if (fs::file_size(folder_ / name, missing) != id.bytes || missing) {
      return false;
    }
    const auto hash = sha256_of_file(folder_ / name);
    if (!hash || *hash != id.hash) {
      fs::remove(folder_ / name, missing);
      return false;
    }
    verified_[name] = true;
  }
  return true;
}

bool CaseFetcher::open_manifest(const FileId &id) {
  const auto text = base::read_file(place_of(id.hash), kMaxManifestBytes);
  auto manifest = text ? read_manifest(*text) : tl::unexpected(text.error());
  if (!manifest) {
    fail(manifest.error().message, wire::boot_now_ns());
    return false;
  }
  manifest_ = std::move(*manifest);
  for (const auto &[name, file] : manifest_->files) {
    total_bytes_ += file.bytes;
    if (std::find(missing_.begin(), missing_.end(), file) == missing_.end()) {
      missing_.push_back(file);
    }
  }
  done_bytes_ = 0;
  return true;
}

// Asks for the next chunks, of the next file that is not here.
void CaseFetcher::download_next(std::int64_t now_ns) {
  while (!download_) {
    FileId next = *wanted_;
    if (manifest_) {
      while (!missing_.empty() && is_here(missing_.back())) {
        missing_.pop_back();
      }
      if (missing_.empty()) {
        return complete();
      }
      next = missing_.back();
    } else if (is_here(next)) {
      if (!open_manifest(next)) {
        return;
      }
      continue;
    }
    auto begun = Download::begin(next, place_of(next.hash));
    if (!begun) {
      return fail(begun.error().message, now_ns);
    }
    download_.emplace(std::move(*begun));
  }
  while (const auto chunks = download_->ask(now_ns)) {
    wire::CaseRequest request{};
    (void)wire::set_name(request.client, client_);
    std::copy(download_->id().hash.begin(), download_->id().hash.end(), std::begin(request.file));
    request.first_chunk = chunks->first;
    request.count = chunks->count;
    (void)requests_.write(request);
  }
  const std::lock_guard lock(mutex_);
  const double here = static_cast<double>(done_bytes_ + (manifest_ ? download_->received_bytes() : 0));
  status_.fraction = total_bytes_ == 0 ? 0.0 : std::min(1.0, here / static_cast<double>(total_bytes_));
}

void CaseFetcher::complete() {
  complete_ = true;
  const std::string hash = to_hex(wanted_->hash);
  {
    const std::lock_guard lock(mutex_);
    if (known_.size() >= kKnownCases && !known_.contains(hash)) {
      const std::string before = status_.hash;
      std::erase_if(known_, [&](const auto &entry) { return entry.first != before; });
      while (known_.size() >= kKnownCases) {
        known_.erase(known_.begin());
      }
    }
    known_[hash] = {manifest_->id, manifest_->json, {manifest_->files.begin(), manifest_->files.end()}};
    status_ = {CaseStatus::State::kComplete, 1.0, hash, manifest_->id, {}};
  }
  forget_old();
}

void CaseFetcher::fail(const std::string &why, std::int64_t now_ns) {
  std::string id;
  {
    const std::lock_guard lock(mutex_);
    id = status_.id;
  }
  set({CaseStatus::State::kFailed, 0.0, {}, id, why});
  manifest_.reset();
  missing_.clear();
  total_bytes_ = done_bytes_ = 0;
  retry_ns_ = now_ns + kRetry_ns;
}

void CaseFetcher::forget_old() {
  struct Kept {
    fs::file_time_type time;
    fs::path path;
    std::uintmax_t bytes;
  };
  std::vector<Kept> kept;
  std::uintmax_t total = 0;
  std::error_code failed;
  for (auto it = fs::directory_iterator(folder_, failed); !failed && it != fs::directory_iterator();
       it.increment(failed)) {
    std::error_code unreadable;
    const auto bytes = it->file_size(unreadable);
    if (!unreadable) {
      kept.push_back({it->last_write_time(unreadable), it->path(), bytes});
      total += bytes;
    }
  }
  std::sort(kept.begin(), kept.end(), [](const Kept &a, const Kept &b) { return a.time < b.time; });
  const std::lock_guard lock(mutex_);
  const auto in_use = [&](const std::string &name) {
    return std::any_of(known_.begin(), known_.end(), [&](const auto &entry) {
      const auto &files = entry.second.files;
      return entry.first == name || std::any_of(files.begin(), files.end(),
                                                [&](const auto &file) { return to_hex(file.second.hash) == name; });
    });
  };
  for (const Kept &one : kept) {
    const std::string name = one.path.filename().string();
    if (total > kMaxKeptBytes && !in_use(name)) {
      fs::remove(one.path, failed);
      verified_.erase(name);
      total -= one.bytes;
    }
  }
}

} // namespace bregma::casefiles
