#include "casefile/poses.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <memory>
#include <optional>
#include <system_error>

#include <Eigen/LU>
#include <archive.h>
#include <archive_entry.h>
#include <zlib.h>

#include "base/text.hpp"
#include "casefile/pose_text.hpp"

namespace bregma::casefile {

namespace {

namespace fs = std::filesystem;

// Written matrices have at least six digits. A matrix that is farther from a rotation than this is not one.
constexpr double kOrthogonality = 1e-3;
constexpr std::size_t kMaxEntryBytes = 1 << 20;

// "1378476416922755200" of "./1378476416922755200.txt".
std::optional<std::int64_t> time_of(const fs::path &file) {
  return base::parsed_number<std::int64_t>(file.stem().string());
}

bool is_pose_file(const fs::path &file) {
  return file.extension() == ".txt" && !file.filename().string().starts_with(".");
}

base::Result<TimedPose> parse_pose(const std::string &content, const fs::path &file, const std::string &shown_name) {
  const auto time_ns = time_of(file);
  if (!time_ns) {
    return base::failure(shown_name +
                         ": the file's name must be the time of the pose in ns, for example 1378476416922755200.txt");
  }
  std::vector<double> numbers;
  std::size_t line_start = 0;
  for (int line = 1; line_start < content.size(); ++line) {
    const std::size_t line_end = std::min(content.find('\n', line_start), content.size());
    const auto row = detail::parse_numbers(std::string_view(content).substr(line_start, line_end - line_start));
    line_start = line_end + 1;
    const std::string place = shown_name + ":" + std::to_string(line) + ": ";
    if (!row) {
      return base::failure(place + row.error());
    }
    if (row->empty()) {
      continue;
    }
    if (row->size() != 4) {
      return base::failure(place + "a row of the matrix has 4 numbers, this one has " + std::to_string(row->size()));
    }
    numbers.insert(numbers.end(), row->begin(), row->end());
  }
  const auto pose = detail::rigid_from_rows(numbers);
  if (!pose) {
    return base::failure(shown_name + ": " + pose.error());
  }
  return TimedPose{*time_ns, *pose};
}

base::Result<PoseSeries> sorted(PoseSeries series, const fs::path &source) {
  if (series.poses.empty()) {
    return base::failure(source.string() + ": holds no poses (files named <time in ns>.txt with a 4x4 matrix each)");
  }
  std::stable_sort(series.poses.begin(), series.poses.end(),
                   [](const TimedPose &a, const TimedPose &b) { return a.time_ns < b.time_ns; });
  return series;
}

base::Result<PoseSeries> read_folder(const fs::path &folder) {
  PoseSeries series;
  std::error_code error;
  std::vector<fs::path> files;
  for (auto it = fs::directory_iterator(folder, error); !error && it != fs::directory_iterator(); it.increment(error)) {
    if (is_pose_file(it->path())) {
      files.push_back(it->path());
    }
  }
  if (error) {
    return base::failure(folder.string() + ": " + error.message());
  }
  std::sort(files.begin(), files.end()); // so that the same one of several damaged files is always reported
  for (const fs::path &file : files) {
    std::ifstream in(file, std::ios::binary);
    const std::string content(std::istreambuf_iterator<char>(in), {});
    if (!in) {
      return base::failure(file.string() + ": cannot be read");
    }
    auto pose = parse_pose(content, file, file.string());
    if (!pose) {
      return tl::unexpected(pose.error());
    }
    series.poses.push_back(*pose);
  }
  return sorted(std::move(series), folder);
}

struct CloseArchive {
  void operator()(archive *reader) const { archive_read_free(reader); }
};

// libarchive reads no further than the archive's end mark, does not miss it where the file was cut between two entries,
// and does not compare gzip's checksum. content: after inflating.
base::Result<void> check_archive_whole(const fs::path &file, bool is_tar) {
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> in(gzopen(file.c_str(), "rb"), gzclose);
  if (!in) {
    return base::failure(file.string() + ": cannot be read");
  }
  constexpr std::size_t kEndMark = 1024; // of tar: two blocks of zeros
  std::string end;
  std::array<char, 1 << 16> block{};
  int count = 0;
  while ((count = gzread(in.get(), block.data(), block.size())) > 0) {
    end.append(block.data(), static_cast<std::size_t>(count));
    end.erase(0, end.size() - std::min(end.size(), kEndMark));
  }
  int problem = Z_OK;
  static_cast<void>(gzerror(in.get(), &problem));
  if (count < 0 || problem != Z_OK) {
    return base::failure(file.string() +
                         ": is not whole: its compressed data end early or do not match their checksum");
  }
  const bool plain_tar = is_tar && (gzdirect(in.get()) == 0 || base::lower(file.extension().string()) == ".tar");
  if (plain_tar && (end.size() < kEndMark || end.find_first_not_of('\0') != std::string::npos)) {
    return base::failure(file.string() + ": is not whole: the archive has no end mark");
  }
  return {};
}

base::Result<PoseSeries> read_archive(const fs::path &file) {
  const std::unique_ptr<archive, CloseArchive> reader(archive_read_new());
  archive_read_support_filter_all(reader.get());
  archive_read_support_format_tar(reader.get());
  archive_read_support_format_zip(reader.get());
  const auto damaged = [&] {
    const char *text = archive_error_string(reader.get());
    return base::failure(file.string() + ": cannot be read as an archive: " + (text == nullptr ? "damaged" : text));
  };
  if (archive_read_open_filename(reader.get(), file.c_str(), std::size_t{1} << 16U) != ARCHIVE_OK) {
    return damaged();
  }
  PoseSeries series;
  archive_entry *entry = nullptr;
  int status = archive_read_next_header(reader.get(), &entry);
  for (; status == ARCHIVE_OK; status = archive_read_next_header(reader.get(), &entry)) {
    const char *path = archive_entry_pathname(entry);
    if (path == nullptr || archive_entry_filetype(entry) != AE_IFREG || !is_pose_file(path)) {
      continue;
    }
    const std::string shown_name = file.string() + ": " + fs::path(path).filename().string();
    std::string content(kMaxEntryBytes, '\0');
    const auto size = archive_read_data(reader.get(), content.data(), content.size());
    if (size < 0) {
      return damaged();
    }
    content.resize(static_cast<std::size_t>(size));
    auto pose = parse_pose(content, path, shown_name);
    if (!pose) {
      return tl::unexpected(pose.error());
    }
    series.poses.push_back(*pose);
  }
  if (status != ARCHIVE_EOF) {
    return damaged();
  }
  const bool is_tar = (archive_format(reader.get()) & ARCHIVE_FORMAT_BASE_MASK) == ARCHIVE_FORMAT_TAR;
  if (auto whole = check_archive_whole(file, is_tar); !whole) {
    return tl::unexpected(whole.error());
  }
  return sorted(std::move(series), file);
}

} // namespace

namespace detail {

tl::expected<std::vector<double>, std::string> parse_numbers(std::string_view text) {
  std::vector<double> out;
  constexpr std::string_view kBlank = " \t\r\n";
  for (std::size_t start = text.find_first_not_of(kBlank); start != std::string_view::npos;
       start = text.find_first_not_of(kBlank, start)) {
    const std::size_t end = std::min(text.find_first_of(kBlank, start), text.size());
    const std::string_view word = text.substr(start, end - start);
    double value = 0.0;
    const auto parsed = std::from_chars(word.data(), word.data() + word.size(), value);
    // result_out_of_range also occurs for denormals, which PLUS writes. They are read as zero.
    const bool number = parsed.ptr == word.data() + word.size() && parsed.ec != std::errc::invalid_argument;
    if (!number || !std::isfinite(value)) {
      return tl::unexpected("\"" + std::string(word.substr(0, 40)) + "\" is not a finite number");
    }
    out.push_back(value);
    start = end;
  }
  return out;
}

tl::expected<NamedRigid, std::string> rigid_from_rows(const std::vector<double> &numbers) {
  if (numbers.size() != 16) {
    return tl::unexpected("a transform has 16 numbers, this one has " + std::to_string(numbers.size()));
  }
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> m(numbers.data());
  if ((m.row(3) - Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0)).cwiseAbs().maxCoeff() > 1e-9) {
    return tl::unexpected(std::string("the last row of the matrix must be 0 0 0 1"));
  }
  const Eigen::Matrix3d R = m.topLeftCorner<3, 3>();
  const double error = (R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (error > kOrthogonality || R.determinant() < 0.0) {
    return tl::unexpected(std::string("the matrix is not a rotation") +
                          (R.determinant() < 0.0 ? ": it mirrors" : ": its rows are not perpendicular unit vectors"));
  }
  return NamedRigid(R, m.topRightCorner<3, 1>());
}

} // namespace detail

base::Result<PoseSeries> read_pose_matrices(const fs::path &folder_or_archive) {
  std::error_code error;
  if (fs::is_directory(folder_or_archive, error)) {
    return read_folder(folder_or_archive);
  }
  if (!fs::exists(folder_or_archive, error)) {
    return base::failure(folder_or_archive.string() + ": no such file or folder");
  }
  return read_archive(folder_or_archive);
}

base::Result<PoseSeries> read_poses(const fs::path &path, std::string_view transform) {
  const std::string extension = base::lower(path.extension().string());
  constexpr std::array kSequences{".mha", ".mhd", ".nrrd", ".nhdr", ".seq"};
  if (std::find(kSequences.begin(), kSequences.end(), extension) == kSequences.end()) {
    return read_pose_matrices(path);
  }
  const auto sequence = read_transform_sequence(path);
  if (!sequence) {
    return tl::unexpected(sequence.error());
  }
  const std::vector<std::string> names = sequence->names();
  return sequence->series(transform.empty() && names.size() == 1 ? names.front() : transform);
}

} // namespace bregma::casefile
