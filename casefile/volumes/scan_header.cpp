#include "casefile/volumes/scan_header.hpp"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <system_error>
#include <utility>
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
const gdcm::Tag kBandwidth(0x0018, 0x0095), kAcquired(0x0018, 0x1310), kOrientation(0x0020, 0x0037),
    kRows(0x0028, 0x0010), kColumns(0x0028, 0x0011), kSpacing(0x0028, 0x0030);

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
  std::set<gdcm::Tag> tags{kBandwidth, kAcquired, kOrientation, kRows, kColumns, kSpacing};
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
  const auto numbers = [&](const gdcm::Tag &tag) { return decimal_numbers(value_of_tag(filter.ToString(tag))); };
  const std::vector<double> bandwidth = numbers(kBandwidth), acquired = numbers(kAcquired),
                            orientation = numbers(kOrientation), rows = numbers(kRows), columns = numbers(kColumns),
                            spacing = numbers(kSpacing);
  out.bandwidth_Hz = bandwidth.size() == 1 ? bandwidth.front() : 0.0;
  const bool along_rows = out.phase_encoding.starts_with("COL");
  if ((along_rows || out.phase_encoding == "ROW") && orientation.size() == 6) {
    out.read_out = Eigen::Vector3d(orientation.data() + (along_rows ? 0 : 3));
    // Samples of the read-out along rows or columns, then of the phase encoding; the others are 0.
    const double samples = acquired.size() == 4 ? std::max(acquired[0], acquired[1]) : 0.0;
    if (samples > 0.0 && rows.size() == 1 && columns.size() == 1 && spacing.size() == 2) {
      out.read_out_pixel_mm = (along_rows ? columns[0] * spacing[1] : rows[0] * spacing[0]) / samples;
    }
  }
  return out;
}

// Sorted. A file without the mark of DICOM part 10 is one where its whole content is a data set with an image.
base::Result<std::vector<fs::path>> images_in(const fs::path &path) {
  std::error_code failed;
  std::vector<fs::path> out;
  if (!fs::is_directory(path, failed)) {
    if (is_dicom_file(path)) {
      out.push_back(path);
    }
    return out;
  }
  for (fs::recursive_directory_iterator entry(path, failed), end; !failed && entry != end; entry.increment(failed)) {
    std::error_code ignored;
    if (!entry->is_regular_file(ignored)) {
      continue;
    }
    const auto whole = read_dicom_file(entry->path());
    if (!whole && is_dicom_file(entry->path())) {
      return tl::unexpected(whole.error());
    }
    if (whole && whole->has_pixels && !whole->series.empty()) {
      out.push_back(entry->path());
    }
  }
  if (failed) {
    return base::failure(path.string() + ": cannot be listed: " + failed.message());
  }
  std::sort(out.begin(), out.end());
  return out;
}

// "states the patient position "FFS", not that "HFS"": what two images of one scan have in common; empty if all is.
std::string difference(const ScanHeader &first, const ScanHeader &other) {
  const auto differ = [](const std::string &what, const std::string &is, const std::string &was) {
    return "states the " + what + " \"" + is + "\", not that \"" + was + "\"";
  };
  if (first.modality != other.modality) {
    return differ("modality", other.modality, first.modality);
  }
  if (first.vendor_correction() != other.vendor_correction()) {
    return differ("image type", other.image_type, first.image_type);
  }
  if (first.patient_position != other.patient_position) {
    return differ("patient position", other.patient_position, first.patient_position);
  }
  return first.scanner() == other.scanner() ? std::string() : differ("scanner", other.scanner(), first.scanner());
}

} // namespace

std::string ScanHeader::scanner() const {
  std::string out;
  for (const std::string *part : {&manufacturer, &model, &serial_number}) {
    out += (out.empty() || part->empty() ? "" : " ") + *part;
  }
  return out;
}

bool is_dicom(const fs::path &path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored) || is_dicom_file(path);
}

VendorCorrection ScanHeader::vendor_correction() const {
  VendorCorrection out = VendorCorrection::kNotStated;
  for (const std::string_view value : base::cells(image_type, '\\')) {
    const std::string word = base::lower(value);
    if (word == "dis2d" || word == "dis3d") {
      return VendorCorrection::kCorrected;
    }
    out = word == "nd" ? VendorCorrection::kNone : out;
  }
  return out;
}

bool ScanHeader::shows_phase() const {
  const auto words = base::cells(image_type, '\\');
  return std::any_of(words.begin(), words.end(), [](std::string_view word) {
    return base::lower(word) == "p" || base::lower(word).starts_with("phase");
  });
}

base::Result<ScanHeader> read_scan_header(const fs::path &path, const std::string &series) {
  const auto files = images_in(path);
  if (!files) {
    return tl::unexpected(files.error());
  }
  std::optional<ScanHeader> first;
  fs::path first_file;
  std::map<std::string, std::string> descriptions; // of the series
  for (const fs::path &file : *files) {
    auto header = read_file(file);
    if (!header) {
      return header;
    }
    descriptions.try_emplace(header->series_uid, header->series_description);
    if (first ? header->series_uid != first->series_uid : !series.empty() && header->series_uid != series) {
      continue;
    }
    if (!first) {
      first = std::move(*header);
      first_file = file;
    } else if (const std::string text = difference(*first, *header); !text.empty()) {
      return base::failure(file.string() + ": " + text + " of " + first_file.string() +
                           ": the images are not of one scan");
    }
  }
  if (series.empty() && descriptions.size() > 1) {
    std::string list;
    for (const auto &[uid, description] : descriptions) {
      list +=
          (list.empty() ? "" : "; ") + uid + " (" + (description.empty() ? "without a description" : description) + ")";
    }
    return base::failure(path.string() + ": the folder holds " + std::to_string(descriptions.size()) +
                         " DICOM series, choose one of: " + list);
  }
  return first ? base::Result<ScanHeader>(std::move(*first))
               : base::failure(path.string() + ": no DICOM image" + (series.empty() ? "" : " of the series " + series));
}

} // namespace bregma::casefile
