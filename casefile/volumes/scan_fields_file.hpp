// The distortion of a scanner's scans as files: one displacement field (displacement_file.hpp), or two where B0 is
// known as well: that of the gradients, and beside it that of B0 (NAME.b0.nrrd), each with its errors.
//
// In memory the frame is Image (RAS). Every problem is an Error that names the file.
#pragma once

#include <filesystem>
#include <vector>

#include "algorithms/mri/scan_fields.hpp"
#include "base/result.hpp"
#include "casefile/volumes/displacement_file.hpp"

namespace bregma::casefile {

// The path must end in .nrrd. Files are replaced; one of B0 that does not belong to these fields is removed.
[[nodiscard]] base::Result<void> write_scan_fields(const std::filesystem::path &path, const mri::ScanFields &fields,
                                                   const FieldHeader &header);

struct ScanFieldsFile {
  FieldHeader header;
  mri::ScanFields fields;
};
// Refused: a file of B0 alone, a part of the gradients without its B0 or with that of another field.
[[nodiscard]] base::Result<ScanFieldsFile> read_scan_fields(const std::filesystem::path &path);

// All files that a field may have, those of B0 included.
[[nodiscard]] std::vector<std::filesystem::path> scan_field_files(const std::filesystem::path &path);
// The file of the part of B0.
[[nodiscard]] std::filesystem::path b0_file_of(const std::filesystem::path &path);

} // namespace bregma::casefile
