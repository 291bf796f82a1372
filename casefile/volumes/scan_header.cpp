#include "casefile/volumes/scan_header.hpp"

#include <algorithm>
#include <charconv>
#include <set>
#include <string_view>
#include <vector>

#include <gdcmReader.h>
#include <gdcmStringFilter.h>
#include <gdcmTag.h>

#include "base/text.hpp"
#include "casefile/volumes/dicom_file.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

struct ScanField {
  gdcm::Tag tag;
  std::string ScanHeader::*value;
};
const std::vector<ScanField> &fields() {
  static const std::vector<ScanField> table = {
      {{0x0008, 0x0060}, &ScanHeader::modality},       {{0x0008, 0x0008}, &ScanHeader::image_type},
      {{0x0008, 0x0070}, &ScanHeader::manufacturer},   {{0x0008, 0x1090}, &ScanHeader::model},
      {{0x0018, 0x1000}, &ScanHeader::serial_number},  {{0x0008, 0x103e}, &ScanHeader::series_description},
      {{0x0020, 0x000e}, &ScanHeader::series_uid},     {{0x0018, 0x5100}, &ScanHeader::patient_position},
      {{0x0018, 0x1312}, &ScanHeader::phase_encoding}, {{0x0008, 0x0022}, &ScanHeader::acquisition_date}};
  return table;
}
const gdcm::Tag kBandwidth(0x0018, 0x0095);

// Without the padding of DICOM, and without control characters, which could reach a terminal.
// Values are padded to an even length, with blanks or NUL.
std::string value_of_tag(std::string text) {
  std::erase_if(text, [](char c) { return static_cast<unsigned char>(c) < 0x20; });
  return std::string(base::trimmed(text));
}

base::Result<ScanHeader> read_file(const fs::path &file) {
  if (const auto whole = read_dicom_file(file); !whole) {
    return tl::unexpected(whole.error());
  }
  std::set<gdcm::Tag> tags{kBandwidth};
  for (const ScanField &field : fields()) {
    tags.insert(field.tag);
  }
  gdcm::Reader reader;
  reader.SetFileName(file.c_str());
  if (!reader.ReadSelectedTags(tags)) {
    return base::failure(file.string() + ": its DICOM header cannot be read");
  }
  gdcm::StringFilter filter;
  filter.SetFile(reader.GetFile());
  ScanHeader out;
  for (const ScanField &field : fields()) {
    out.*(field.value) = value_of_tag(filter.ToString(field.tag));
  }
  const std::string bandwidth = value_of_tag(filter.ToString(kBandwidth));
  std::from_chars(bandwidth.data(), bandwidth.data() + bandwidth.size(), out.bandwidth_Hz);
  return out;
}

} // namespace

std::string ScanHeader::scanner() const {
  std::string out;
  for (const std::string *part : {&manufacturer, &model, &serial_number}) {
    out += (out.empty() || part->empty() ? "" : " ") + *part;
  }
  return out;
}

bool ScanHeader::vendor_corrected() const {
  for (std::size_t begin = 0; begin <= image_type.size();) {
    const std::size_t end = std::min(image_type.find('\\', begin), image_type.size());
    const std::string_view value = std::string_view(image_type).substr(begin, end - begin);
    if (value == "DIS2D" || value == "DIS3D") {
      return true;
    }
    begin = end + 1;
  }
  return false;
}

base::Result<ScanHeader> read_scan_header(const fs::path &path, const std::string &series) {
  std::error_code failed;
  std::vector<fs::path> files;
  if (fs::is_directory(path, failed)) {
    for (const fs::directory_entry &entry : fs::directory_iterator(path, failed)) {
      if (entry.is_regular_file(failed) && is_dicom_file(entry.path())) {
        files.push_back(entry.path());
      }
    }
    std::sort(files.begin(), files.end());
  } else if (is_dicom_file(path)) {
    files.push_back(path);
  }
  for (const fs::path &file : files) {
    auto header = read_file(file);
    if (!header || series.empty() || header->series_uid == series) {
      return header;
    }
  }
  return base::failure(path.string() + ": no DICOM file" + (series.empty() ? "" : " of the series " + series));
}

} // namespace bregma::casefile
