// One file of a case on its way: which chunks to ask for next, and the file once it is whole.
//
// Chunks arrive in any order, several times or not at all. At most kWindow are under way, so that a transfer never
// fills the buffers that the states of others need. What has not arrived within kPatience_ns is asked for again.
//
// Threads: one object, one thread. No DDS and no clock: the caller states chunks and times.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <span>
#include <vector>

#include "base/result.hpp"
#include "casefile/sha256.hpp"

namespace bregma::casefiles {

using casefile::from_hex;
using casefile::Hash;
using casefile::sha256;
using casefile::sha256_of_file;
using casefile::to_hex;

struct FileId {
  Hash hash{};
  std::uint64_t bytes = 0;
  friend bool operator==(const FileId &, const FileId &) = default;
};

[[nodiscard]] std::uint32_t crc32_of(std::span<const std::byte> data);

class Download {
public:
  static constexpr std::uint64_t kWindow = 16;
  static constexpr std::int64_t kPatience_ns = 300'000'000;

  // The file is written as `place`.part and gets its name when it is whole. An error if it cannot be made, or is larger
  // than a case's file may be.
  [[nodiscard]] static base::Result<Download> begin(const FileId &id, const std::filesystem::path &place);

  struct Chunks {
    std::uint64_t first = 0;
    std::uint32_t count = 0;
  };
  // What to ask for now; empty: nothing.
  [[nodiscard]] std::optional<Chunks> ask(std::int64_t now_ns);

  // False for a chunk that is not of this file, has another length or checksum, or is here already.
  bool accept(std::uint64_t chunk, std::uint32_t crc32, std::span<const std::byte> data);

  [[nodiscard]] const FileId &id() const { return id_; }
  [[nodiscard]] std::uint64_t received_bytes() const { return received_bytes_; }
  [[nodiscard]] bool complete() const { return received_ == asked_ns_.size(); }
  // Precondition: complete. An error if the disk failed or the content is not that of the hash; the file is removed.
  [[nodiscard]] base::Result<void> finish();

private:
  Download(const FileId &id, std::filesystem::path place);
  [[nodiscard]] std::uint64_t bytes_of(std::uint64_t chunk) const;

  FileId id_;
  std::filesystem::path place_;
  std::filesystem::path part_;
  std::ofstream out_;
  std::vector<std::int64_t> asked_ns_; // per chunk: 0 not asked for, kHere, or when
  std::uint64_t received_ = 0;
  std::uint64_t received_bytes_ = 0;
};

} // namespace bregma::casefiles
