// What survives a killed daemon: everything the session knows, in one JSON file that is always whole.
//
// Written to a temporary file, synced, renamed over the old one, and the folder synced; so after a power cut either the
// old or the new session is there. Numbers come back bit for bit. A file whose checksum, version or content does not
// hold is never half believed: it is refused with a reason and kept aside.
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
  std::string case_id;   // a folder that holds another case by now is not restored
  std::string recording; // the session file that was written to
  std::uint64_t revision = 0;
  std::map<std::string, CalibratedTip> tips;       // by tool
  std::map<std::string, FiducialSample> fiducials; // by fiducial
  std::vector<SurfaceSample> surface;
  std::optional<RegistrationAccepted> accepted;
  std::map<std::string, JudgedCheck> checks; // by landmark, the last touch of each since acceptance
};

[[nodiscard]] std::string to_json(const SessionData &data);
// name: of the file, for the error.
[[nodiscard]] base::Result<SessionData> from_json(const std::string &text, const std::string &name);

class SnapshotFile {
public:
  // The folder is made when it is not there.
  explicit SnapshotFile(const std::filesystem::path &folder);

  // Nothing is lost when it fails: the file of the last success stays.
  [[nodiscard]] base::Result<void> save(const SessionData &data) const;
  // Empty when there is none. A damaged file becomes session.json.bad, and the error says why.
  [[nodiscard]] base::Result<std::optional<SessionData>> load() const;
  // Renames the file to session.json.bad: whole, but of no use (its case is gone).
  void set_aside() const;
  [[nodiscard]] const std::filesystem::path &path() const { return path_; }

private:
  std::filesystem::path path_;
};

} // namespace bregma::server
