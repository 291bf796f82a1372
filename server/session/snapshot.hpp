// Snapshot of the session for a restart: its complete state in one JSON file that is never partially written.
//
// The file is written to a temporary file, synced and renamed over the old one, and the folder is synced. After a power
// failure either the old or the new snapshot exists. Numbers are restored bit for bit. A file with an invalid checksum,
// version or content is rejected as a whole with a reason, and is kept under another name.
// Threads: any, one at a time. Blocks for the disk: control thread only.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/result.hpp"
#include "server/session/messages.hpp"

namespace bregma::server {

struct CalibratedTip { // in the tool's body frame
  Array3 tip_mm{};
  Array9 covariance_mm2{};
  double rms_mm = 0.0;
  std::int64_t time_ns = 0;
};

struct SessionData {
  wire::SessionState stage = bregma_wire_SESSION_IDLE;
  std::string case_folder;
  std::string case_id;       // the session is not restored if the folder contains another case
  std::string case_checksum; // nor if its content is another (case_checksum.hpp)
  std::string recording;     // the session file of the recording
  std::uint64_t revision = 0;
  std::map<std::string, CalibratedTip> tips;       // per tool
  std::map<std::string, FiducialSample> fiducials; // per fiducial
  std::vector<SurfaceSample> surface;
  std::optional<RegistrationAccepted> accepted;
  std::map<std::string, JudgedCheck> checks; // the last touch per landmark since acceptance
};

[[nodiscard]] std::string to_json(const SessionData &data);
// name: the file's name, for errors.
[[nodiscard]] base::Result<SessionData> from_json(const std::string &text, const std::string &name);

class SnapshotFile {
public:
  // Creates the folder if it does not exist.
  explicit SnapshotFile(const std::filesystem::path &folder);

  // If it fails, the last successfully written file remains.
  [[nodiscard]] base::Result<void> save(const SessionData &data) const;
  // Empty if there is no file. One that is damaged or cannot be read is set aside, and the error states the reason.
  [[nodiscard]] base::Result<std::optional<SessionData>> load() const;
  // Renames a file that is not used (it is damaged, its case has changed, or another one is loaded) to
  // session.json.bad, or session.json.bad.2 and so on where earlier ones are kept. Returns the name. After a hundred
  // the last one is replaced.
  std::filesystem::path set_aside() const;
  [[nodiscard]] const std::filesystem::path &path() const { return path_; }

private:
  std::filesystem::path path_;
};

} // namespace bregma::server
