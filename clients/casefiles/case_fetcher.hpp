// Keeps the files of the followed daemon's case on this host's disk, from bregma-case-server over DDS.
//
// Files are kept by their hash in one folder that only this user can read, also after the case is closed: a case that
// is opened again needs nothing from the network. The oldest are removed above kMaxKeptBytes.
//
// Threads: a thread of its own fetches. All members may be called from any thread.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "base/result.hpp"
#include "clients/casefiles/download.hpp"
#include "clients/casefiles/manifest.hpp"
#include "idl/dds.hpp"

namespace bregma::casefiles {

inline constexpr std::uintmax_t kMaxKeptBytes = std::uintmax_t{8} << 30;

struct CaseStatus {
  enum class State : std::uint32_t { kNone = 0, kNoServer = 1, kOnItsWay = 2, kComplete = 3, kFailed = 4 };
  State state = State::kNoServer; // kNone: the server says that no case is loaded
  double fraction = 0.0;
  std::string hash; // hexadecimal; empty unless complete
  std::string id;
  std::string text; // why it failed
};

class CaseFetcher {
public:
  // An error if the folder cannot be made. The participant outlives the fetcher.
  [[nodiscard]] static base::Result<std::filesystem::path> make_folder(const std::filesystem::path &folder);
  CaseFetcher(const dds::Participant &participant, std::filesystem::path folder);
  ~CaseFetcher();
  CaseFetcher(const CaseFetcher &) = delete;
  CaseFetcher &operator=(const CaseFetcher &) = delete;

  // The host of the daemon that is followed: only its server's case is used.
  void follow(const wire::BootId &boot_id);

  [[nodiscard]] CaseStatus status() const;
  [[nodiscard]] std::optional<std::string> json() const; // of /case, while the case is complete
  // Of the case that is complete, or was before it; the file is on the disk.
  [[nodiscard]] std::optional<std::filesystem::path> file(std::string_view case_hash, std::string_view name) const;

private:
  using Boot = std::array<std::uint8_t, 16>;
  struct Known {
    std::string id, json;
    std::map<std::string, FileId, std::less<>> files;
  };

  void run();
  void take_offers();
  void take_chunks(std::int64_t now_ns);
  void advance(std::int64_t now_ns);
  void start(const wire::CaseOffer &offer);
  bool open_manifest(const FileId &id);
  bool is_here(const FileId &id);
  void download_next(std::int64_t now_ns);
  void complete();
  void fail(const std::string &why, std::int64_t now_ns);
  void forget_old();
  void set(CaseStatus status);
  [[nodiscard]] std::filesystem::path place_of(const Hash &hash) const { return folder_ / to_hex(hash); }

  std::filesystem::path folder_;
  std::string client_;
  dds::Reader<wire::CaseOffer> offers_;
  dds::Writer<wire::CaseRequest> requests_;
  dds::Reader<wire::CaseChunk> chunks_;
  dds::WaitSet wait_;

  // Of the thread.
  std::map<std::string, wire::CaseOffer> offered_; // by server
  std::optional<FileId> wanted_;                   // the manifest of the case that is fetched, or is complete
  std::optional<Manifest> manifest_;
  std::vector<FileId> missing_;
  std::optional<Download> download_;
  std::map<std::string, bool> verified_; // files on the disk whose content was compared with their hash
  std::uint64_t total_bytes_ = 0;
  std::uint64_t done_bytes_ = 0;
  bool complete_ = false;
  std::int64_t retry_ns_ = 0;

  mutable std::mutex mutex_; // of the rest
  Boot followed_{};
  CaseStatus status_;
  std::map<std::string, Known, std::less<>> known_; // by the case's hash; the current one, and the one before it

  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

} // namespace bregma::casefiles
