#include "casefile/volumes/patient.hpp"

#include <algorithm>
#include <fstream>
#include <set>
#include <string_view>
#include <system_error>
#include <vector>

#include <gdcmTrace.h>
#include <itkGDCMImageIO.h>
#include <itkMetaDataObject.h>
#include <nlohmann/json.hpp>

#include "casefile/volumes/dicom_file.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

std::string trimmed(std::string text) {
  constexpr std::string_view kBlank(" \0\t", 3);
  text.erase(0, std::min(text.find_first_not_of(kBlank), text.size()));
  text.erase(text.find_last_not_of(kBlank) + 1);
  return text;
}

std::string tag(const itk::MetaDataDictionary &tags, const char *name) {
  std::string out;
  itk::ExposeMetaData(tags, name, out);
  return trimmed(std::move(out));
}

std::string to_utf8(const std::string &text, const std::string &character_set) {
  if (character_set.find("ISO_IR 192") != std::string::npos) {
    return text;
  }
  const bool latin = character_set.find("100") != std::string::npos;
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x80) {
      out += c;
    } else if (latin) {
      out += static_cast<char>(0xC0 | (byte >> 6));
      out += static_cast<char>(0x80 | (byte & 0x3F));
    } else {
      out += '?';
    }
  }
  return out;
}

// "Family^Given^Middle^Prefix^Suffix=ideographic=phonetic"
std::string shown_name(const std::string &stated) {
  const std::string alphabetic = stated.substr(0, stated.find('='));
  std::string out;
  std::size_t from = 0;
  for (int part = 0; from <= alphabetic.size() && part < 3; ++part) {
    const std::size_t end = std::min(alphabetic.find('^', from), alphabetic.size());
    const std::string one = trimmed(alphabetic.substr(from, end - from));
    out += (out.empty() || one.empty() ? "" : part == 1 ? ", " : " ") + one;
    from = end + 1;
  }
  return out;
}

std::string shown_date(const std::string &stated) {
  const bool whole = stated.size() == 8 &&
                     std::all_of(stated.begin(), stated.end(), [](unsigned char c) { return c >= '0' && c <= '9'; });
  return whole ? stated.substr(0, 4) + "-" + stated.substr(4, 2) + "-" + stated.substr(6, 2) : std::string();
}

std::vector<fs::path> candidates(const fs::path &image) {
  std::error_code failed;
  if (!fs::is_directory(image, failed)) {
    return {image};
  }
  std::set<fs::path> files; // in an order that does not depend on the disk
  for (auto it = fs::recursive_directory_iterator(image, failed); !failed && it != fs::recursive_directory_iterator();
       it.increment(failed)) {
    if (it->is_regular_file(failed)) {
      files.insert(it->path());
    }
  }
  return {files.begin(), files.end()};
}

} // namespace

std::optional<Patient> read_patient(const fs::path &image, const std::string &series) {
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  for (const fs::path &file : candidates(image)) {
    if (!is_dicom_file(file) || !read_dicom_file(file)) {
      continue;
    }
    auto io = itk::GDCMImageIO::New();
    io->SetFileName(file.string());
    try {
      io->ReadImageInformation();
    } catch (const itk::ExceptionObject &) { // not an image: read_volume() says what is wrong with a series
      continue;
    }
    const itk::MetaDataDictionary &tags = io->GetMetaDataDictionary();
    if (!series.empty() && tag(tags, "0020|000e") != series) {
      continue;
    }
    if (tag(tags, "0012|0062") == "YES") {
      return std::nullopt;
    }
    const std::string character_set = tag(tags, "0008|0005");
    Patient out{to_utf8(shown_name(tag(tags, "0010|0010")), character_set),
                to_utf8(tag(tags, "0010|0020"), character_set), shown_date(tag(tags, "0010|0030"))};
    return out.name.empty() && out.id.empty() ? std::nullopt : std::optional(std::move(out));
  }
  return std::nullopt;
}

base::Result<void> write_patient(const fs::path &case_folder, const Patient &patient) {
  const fs::path file = case_folder / kPatientFile;
  std::error_code failed;
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  fs::permissions(file, fs::perms::owner_read | fs::perms::owner_write | fs::perms::group_read, failed);
  const nlohmann::json json{{"name", patient.name}, {"id", patient.id}, {"birth_date", patient.birth_date}};
  out << json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
  out.close();
  if (!out || failed) {
    return base::failure(file.string() + ": cannot be written");
  }
  return {};
}

} // namespace bregma::casefile
