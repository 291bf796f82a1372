#include "clients/casefiles/download.hpp"

#include <algorithm>
#include <limits>
#include <system_error>
#include <utility>

#include <zlib.h>

#include "idl/topics.hpp"

namespace bregma::casefiles {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kHere = std::numeric_limits<std::int64_t>::max();
constexpr std::uint64_t kChunkBytes = bregma_wire_CASE_CHUNK_BYTES;
constexpr std::uint64_t kMaxBytes = std::uint64_t{4} << 30;

} // namespace

std::uint32_t crc32_of(std::span<const std::byte> data) {
  return static_cast<std::uint32_t>(
      ::crc32(0, reinterpret_cast<const Bytef *>(data.data()), static_cast<uInt>(data.size())));
}

Download::Download(const FileId &id, fs::path place)
    : id_(id), place_(std::move(place)), part_(place_.string() + ".part"),
      out_(part_, std::ios::binary | std::ios::trunc), asked_ns_((id.bytes + kChunkBytes - 1) / kChunkBytes, 0) {}

base::Result<Download> Download::begin(const FileId &id, const fs::path &place) {
  if (id.bytes == 0 || id.bytes > kMaxBytes) {
    return base::failure("a file of the case has " + std::to_string(id.bytes) + " bytes; 1 to 4 GiB are possible");
  }
  Download out(id, place);
  if (!out.out_) {
    return base::failure(out.part_.string() + ": cannot be made");
  }
  return out;
}

std::uint64_t Download::bytes_of(std::uint64_t chunk) const {
  return std::min(kChunkBytes, id_.bytes - chunk * kChunkBytes);
}

std::optional<Download::Chunks> Download::ask(std::int64_t now_ns) {
  const auto under_way =
      static_cast<std::uint64_t>(std::count_if(asked_ns_.begin(), asked_ns_.end(), [&](std::int64_t at) {
        return at != 0 && at != kHere && now_ns - at < kPatience_ns;
      }));
  if (under_way > kWindow / 2) {
    return std::nullopt; // half a window at a time, for fewer requests
  }
  const auto wanted = [&](std::int64_t at) { return at != kHere && (at == 0 || now_ns - at >= kPatience_ns); };
  const auto first = std::find_if(asked_ns_.begin(), asked_ns_.end(), wanted);
  if (first == asked_ns_.end()) {
    return std::nullopt;
  }
  auto last = first;
  while (last != asked_ns_.end() && wanted(*last) && static_cast<std::uint64_t>(last - first) < kWindow - under_way) {
    *last++ = now_ns;
  }
  return Chunks{static_cast<std::uint64_t>(first - asked_ns_.begin()), static_cast<std::uint32_t>(last - first)};
}

bool Download::accept(std::uint64_t chunk, std::uint32_t crc32, std::span<const std::byte> data) {
  if (chunk >= asked_ns_.size() || asked_ns_[chunk] == kHere || data.size() != bytes_of(chunk) ||
      crc32_of(data) != crc32) {
    return false;
  }
  out_.seekp(static_cast<std::streamoff>(chunk * kChunkBytes));
  out_.write(reinterpret_cast<const char *>(data.data()), static_cast<std::streamsize>(data.size()));
  asked_ns_[chunk] = kHere;
  ++received_;
  received_bytes_ += data.size();
  return true;
}

base::Result<void> Download::finish() {
  out_.close();
  std::error_code ignored;
  if (!out_) {
    fs::remove(part_, ignored);
    return base::failure(part_.string() + ": cannot be written; is the disk full?");
  }
  const auto hash = sha256_of_file(part_);
  if (!hash || *hash != id_.hash) {
    fs::remove(part_, ignored);
    return base::failure(hash ? "a file of the case arrived with another checksum than it was offered"
                              : hash.error().message);
  }
  std::error_code failed;
  fs::rename(part_, place_, failed);
  if (failed) {
    return base::failure(place_.string() + ": cannot be made: " + failed.message());
  }
  return {};
}

} // namespace bregma::casefiles
