#include "casefile/volumes/scan_fields_file.hpp"

#include <memory>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;

DisplacementField file_of(const mri::FieldTable &table, const FieldHeader &header, FieldPart part,
                          const Eigen::Vector3d &mm_per_Hz) {
  DisplacementField out;
  static_cast<FieldHeader &>(out) = header;
  out.displacement_mm = table.displacements();
  out.signed_error_95_mm = table.signed_errors();
  out.max_error_95_mm = table.max_error_95_mm();
  out.part = part;
  out.mm_per_Hz = mm_per_Hz;
  return out;
}

std::shared_ptr<const mri::FieldTable> table_of(DisplacementField file) {
  return std::make_shared<const mri::FieldTable>(std::move(file.displacement_mm), std::move(file.signed_error_95_mm),
                                                 file.max_error_95_mm);
}

} // namespace

fs::path b0_file_of(const fs::path &path) {
  fs::path out = path;
  return out.replace_extension(".b0.nrrd");
}

std::vector<fs::path> scan_field_files(const fs::path &path) {
  const fs::path b0 = b0_file_of(path);
  return {path, error_file_of(path), b0, error_file_of(b0)};
}

base::Result<void> write_scan_fields(const fs::path &path, const mri::ScanFields &fields, const FieldHeader &header) {
  const fs::path b0 = b0_file_of(path);
  if (!fields.has_b0()) {
    std::error_code ignored;
    fs::remove(b0, ignored);
    fs::remove(error_file_of(b0), ignored);
    return write_displacement_field(path, file_of(*fields.table(), header, FieldPart::kOneReadOut, fields.mm_per_Hz()));
  }
  const DisplacementField gradients = file_of(*fields.table(), header, FieldPart::kGradients, Eigen::Vector3d::Zero());
  DisplacementField by_b0 = file_of(*fields.by_b0(), header, FieldPart::kB0, fields.mm_per_Hz());
  by_b0.gradients = field_mark(gradients);
  // That of B0 first: a part of the gradients that is there has its B0 beside it, or one that does not agree.
  return write_displacement_field(b0, by_b0).and_then([&] { return write_displacement_field(path, gradients); });
}

base::Result<ScanFieldsFile> read_scan_fields(const fs::path &path) {
  auto file = read_displacement_field(path);
  if (!file) {
    return tl::unexpected(file.error());
  }
  const FieldHeader header = static_cast<const FieldHeader &>(*file);
  if (file->part == FieldPart::kB0) {
    return base::failure(path.string() + ": holds the part of B0 alone; name the file of the gradients beside it");
  }
  if (file->part == FieldPart::kOneReadOut) {
    const Eigen::Vector3d mm_per_Hz = file->mm_per_Hz;
    return ScanFieldsFile{header, mri::ScanFields(table_of(std::move(*file)), mm_per_Hz)};
  }
  const fs::path b0_path = b0_file_of(path);
  auto b0 = read_displacement_field(b0_path);
  if (!b0) {
    return base::failure(b0.error().message + "; " + path.string() + " holds the part of the gradients alone");
  }
  if (b0->part != FieldPart::kB0 || b0->gradients != field_mark(*file)) {
    return base::failure(b0_path.string() + ": is not the part of B0 that belongs to " + path.string() +
                         ": copy all files of the field, or make it again");
  }
  const Eigen::Vector3d mm_per_Hz = b0->mm_per_Hz;
  try {
    return ScanFieldsFile{header, mri::ScanFields(table_of(std::move(*file)), table_of(std::move(*b0)), mm_per_Hz)};
  } catch (const std::invalid_argument &error) {
    return base::failure(b0_path.string() + ": " + error.what());
  }
}

} // namespace bregma::casefile
