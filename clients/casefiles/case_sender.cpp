#include "clients/casefiles/case_sender.hpp"

#include <algorithm>
#include <utility>

#include "clients/casefiles/download.hpp"
#include "idl/boot_clock.hpp"
#include "idl/names.hpp"

namespace bregma::casefiles {
namespace {

constexpr std::uint64_t kSentChunkBytes = bregma_wire_CASE_CHUNK_BYTES;
constexpr std::uint32_t kMaxChunks = 64; // per request
// Between two chunks, per reader: 64 MB/s, half of a gigabit link. At most one chunk, 0.3 ms of it, is before a state
// in the queue of the network card. Chunks as fast as they are asked for would be 4 ms.
constexpr std::chrono::microseconds kPeriod{500};
constexpr std::size_t kMaxQueue = 1024; // 16 displays that have asked for all they may at once

} // namespace

CaseSender::CaseSender(const dds::Participant &participant, std::string server)
    : server_(std::move(server)), offers_(participant), requests_(participant), chunks_(participant),
      wait_(participant) {
  wait_.attach(requests_);
  offer_none();
}

void CaseSender::publish(wire::CaseOfferState state, const std::string &case_id, const std::string &text) {
  wire::CaseOffer offer{};
  wire::set_text(offer.server, server_);
  const auto boot_id = wire::boot_id();
  std::copy(boot_id.begin(), boot_id.end(), std::begin(offer.boot_id));
  offer.state = state;
  wire::set_text(offer.case_id, case_id);
  std::copy(manifest_.begin(), manifest_.end(), std::begin(offer.manifest));
  offer.manifest_bytes = manifest_bytes_;
  wire::set_text(offer.text, text);
  (void)offers_.write(offer);
}

void CaseSender::offer_none() {
  manifest_ = {};
  manifest_bytes_ = 0;
  files_.clear();
  queue_.clear();
  publish(bregma_wire_CASE_OFFER_NONE, {}, {});
}

void CaseSender::offer_preparing(const std::string &case_id) {
  offer_none();
  publish(bregma_wire_CASE_OFFER_PREPARING, case_id, {});
}

void CaseSender::offer_failed(const std::string &case_id, const std::string &why) {
  offer_none();
  publish(bregma_wire_CASE_OFFER_FAILED, case_id, why);
}

void CaseSender::offer(Bundle bundle) {
  files_ = std::move(bundle.files);
  const auto bytes = std::as_bytes(std::span(bundle.manifest));
  manifest_ = sha256(bytes);
  manifest_bytes_ = bytes.size();
  files_[manifest_].assign(bytes.begin(), bytes.end());
  publish(bregma_wire_CASE_OFFER_READY, bundle.case_id, {});
}

void CaseSender::serve(std::chrono::nanoseconds timeout) {
  const auto end = Clock::now() + timeout;
  for (auto now = Clock::now(); now < end; now = Clock::now()) {
    if (!queue_.empty() && now >= next_) {
      send(queue_.front());
      queue_.pop_front();
      next_ = now + kPeriod * std::max(chunks_.matched_readers(), 1U);
    }
    const auto until = queue_.empty() ? end : std::min(end, next_);
    (void)wait_.wait(std::max<std::chrono::nanoseconds>(until - Clock::now(), std::chrono::nanoseconds(0)));
    requests_.take_each([&](const wire::CaseRequest &request, const dds::SampleInfo &) { enqueue(request); });
    (void)requests_.status();
  }
}

// A chunk that waits already reaches all who asked for it.
void CaseSender::enqueue(const wire::CaseRequest &request) {
  Hash hash;
  std::copy(std::begin(request.file), std::end(request.file), hash.begin());
  const auto found = files_.find(hash);
  if (found == files_.end()) {
    return;
  }
  const std::uint64_t chunks = (found->second.size() + kSentChunkBytes - 1) / kSentChunkBytes;
  const std::uint64_t first = std::min<std::uint64_t>(request.first_chunk, chunks);
  const std::uint64_t last = std::min<std::uint64_t>(first + std::min(request.count, kMaxChunks), chunks);
  for (std::uint64_t i = first; i < last; ++i) {
    const auto same = [&](const Wanted &one) { return one.chunk == i && one.file == hash; };
    if (std::any_of(queue_.begin(), queue_.end(), same)) {
      continue;
    }
    if (queue_.size() == kMaxQueue) {
      ++dropped_chunks_;
    } else {
      Wanted &wanted = queue_.emplace_back();
      wanted.file = hash;
      wanted.chunk = i;
      std::copy(std::begin(request.client), std::end(request.client), std::begin(wanted.client));
    }
  }
}

void CaseSender::send(const Wanted &wanted) {
  const auto found = files_.find(wanted.file);
  if (found == files_.end()) {
    return; // another case has been offered since
  }
  auto &bytes = found->second;
  const std::uint64_t from = wanted.chunk * kSentChunkBytes;
  const std::span data(bytes.data() + from, std::min<std::size_t>(kSentChunkBytes, bytes.size() - from));
  wire::CaseChunk chunk{};
  std::copy(std::begin(wanted.client), std::end(wanted.client), std::begin(chunk.client));
  std::copy(wanted.file.begin(), wanted.file.end(), std::begin(chunk.file));
  chunk.chunk = wanted.chunk;
  chunk.crc32 = crc32_of(data);
  chunk.data._buffer = reinterpret_cast<std::uint8_t *>(data.data()); // Cyclone copies it
  chunk.data._length = chunk.data._maximum = static_cast<std::uint32_t>(data.size());
  (void)chunks_.write(chunk);
  ++sent_chunks_;
}

} // namespace bregma::casefiles
