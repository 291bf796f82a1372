// Who the patient of an image is, as its DICOM header says. Kept in a file of its own in the case's folder, which only
// its owner and its group can read, and nowhere else: no session file, log, topic or manifest contains it.
//
// Blocking. Safe from any thread.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "base/result.hpp"

namespace bregma::casefile {

struct Patient {
  std::string name;       // UTF-8, "Family, Given"; characters of other sets than Latin 1 and UTF-8 are "?"
  std::string id;         // (0010,0020)
  std::string birth_date; // YYYY-MM-DD; empty if it is not stated
};

inline constexpr const char *kPatientFile = "patient.json"; // in the case's folder

// Of the first slice of the series in the folder, or of the file. Empty where that is no DICOM, is marked as
// de-identified (0012,0062), or states neither name nor identity. series: empty for any.
[[nodiscard]] std::optional<Patient> read_patient(const std::filesystem::path &image, const std::string &series);

[[nodiscard]] base::Result<void> write_patient(const std::filesystem::path &case_folder, const Patient &patient);

} // namespace bregma::casefile
