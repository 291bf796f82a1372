#include "casefile/volumes/image_header.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <system_error>

#include <zlib.h>

#include "base/text.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {
namespace {

constexpr std::size_t kMaxHeaderBytes = std::size_t{1} << 20;
constexpr std::size_t kBlock = std::size_t{1} << 18;

struct EndInflate {
  void operator()(z_stream *stream) const {
    inflateEnd(stream);
    delete stream; // NOLINT(cppcoreguidelines-owning-memory): the deleter of its owner
  }
};

tl::unexpected<base::Error> not_whole(const std::filesystem::path &file, const std::string &what) {
  return base::failure(file.string() + ": is not whole: " + what);
}

// Inflates everything: one stream of zlib, or members of gzip behind each other. keep: the bytes of the voxels.
base::Result<std::uint64_t> check_compressed(std::ifstream &in, const StoredData &data, std::uint64_t voxel_bytes,
                                             std::vector<char> *keep) {
  const std::uint64_t needed = data.skipped + voxel_bytes;
  const std::unique_ptr<z_stream, EndInflate> stream(new z_stream{});
  constexpr int kZlibOrGzip = 15 + 32;
  if (inflateInit2(stream.get(), kZlibOrGzip) != Z_OK) {
    return base::failure(data.file.string() + ": zlib cannot be used");
  }
  std::vector<char> packed(kBlock);
  std::vector<char> block(kBlock);
  std::uint64_t found = 0;
  int state = Z_OK;
  while (in.read(packed.data(), static_cast<std::streamsize>(packed.size())), in.gcount() > 0) {
    stream->next_in = reinterpret_cast<Bytef *>(packed.data());
    stream->avail_in = static_cast<uInt>(in.gcount());
    while (stream->avail_in > 0) {
      if (state == Z_STREAM_END) {
        if (stream->next_in[0] == 0) { // padding of an archive
          --stream->avail_in;
          ++stream->next_in;
          continue;
        }
        inflateReset(stream.get());
      }
      stream->next_out = reinterpret_cast<Bytef *>(block.data());
      stream->avail_out = static_cast<uInt>(block.size());
      state = inflate(stream.get(), Z_NO_FLUSH);
      const std::uint64_t made = block.size() - stream->avail_out;
      if (keep != nullptr) {
        const auto from = static_cast<std::ptrdiff_t>(std::clamp(data.skipped, found, found + made) - found);
        const auto to = static_cast<std::ptrdiff_t>(std::clamp(needed, found, found + made) - found);
        keep->insert(keep->end(), block.begin() + from, block.begin() + to);
      }
      found += made;
      if (state != Z_OK && state != Z_STREAM_END && state != Z_BUF_ERROR) {
        return not_whole(data.file, "its compressed data are damaged or do not match their checksum");
      }
    }
  }
  if (state != Z_STREAM_END) {
    return not_whole(data.file, "its compressed data end early, after " + std::to_string(found) + " of " +
                                    std::to_string(needed) + " bytes");
  }
  if (found < needed) {
    return not_whole(data.file, "it holds " + std::to_string(found) + " bytes of voxels, its header asks for " +
                                    std::to_string(needed));
  }
  return found - needed;
}

} // namespace

base::Result<std::array<std::int64_t, 3>> check_shape(const std::filesystem::path &path,
                                                      const std::vector<double> &sizes) {
  std::array<std::int64_t, 3> out{};
  std::string shape;
  double count = 1.0;
  const auto refuse = [&path](const std::string &what) { return base::failure(path.string() + ": the image " + what); };
  for (std::size_t axis = 0; axis < sizes.size(); ++axis) {
    const double size = sizes[axis];
    const bool whole = size == std::floor(size) && std::abs(size) < 1e15;
    shape += (axis > 0 ? " x " : "") + (whole ? std::to_string(static_cast<std::int64_t>(size)) : std::to_string(size));
    if (!whole || size < 1.0) {
      return refuse("is empty: " + shape + " voxels");
    }
    if (axis > 2 && size > 1.0) {
      return refuse("has more than three dimensions: " + shape);
    }
    count *= size;
    if (count > static_cast<double>(kMaxVoxels)) {
      return refuse("is too large: " + shape + "... voxels, at most 2^30 are read");
    }
    if (axis < 3) {
      out[axis] = static_cast<std::int64_t>(size);
    }
  }
  if (sizes.size() < 3) {
    return refuse("has " + std::to_string(sizes.size()) + " dimensions (" + shape + "), a volume has three");
  }
  return out;
}

base::Result<std::uint64_t> check_whole(const StoredData &data, std::uint64_t needed_bytes, std::vector<char> *keep) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(data.file, error);
  std::ifstream in(data.file, std::ios::binary);
  if (error || !in) {
    return base::failure(data.file.string() + ": " + (error ? error.message() : "cannot be read"));
  }
  if (data.compressed) {
    in.seekg(static_cast<std::streamoff>(data.begin));
    return check_compressed(in, data, needed_bytes, keep);
  }
  const std::uint64_t begin = data.begin + data.skipped;
  const std::uint64_t found = size > begin ? size - begin : 0;
  if (found < needed_bytes) {
    return not_whole(data.file, "it holds " + std::to_string(found) + " bytes of voxels, its header asks for " +
                                    std::to_string(needed_bytes));
  }
  if (keep != nullptr) {
    keep->resize(needed_bytes);
    in.seekg(static_cast<std::streamoff>(begin));
    if (!in.read(keep->data(), static_cast<std::streamsize>(needed_bytes))) {
      return base::failure(data.file.string() + ": cannot be read");
    }
  }
  return found - needed_bytes;
}

base::Result<void> check_whole(const StoredData &data, std::uint64_t needed_bytes,
                               const std::filesystem::path &header_file, ImageHeader &header) {
  header.least_bytes = data.compressed || data.file != header_file ? 0 : data.begin + data.skipped + needed_bytes;
  const auto behind = check_whole(data, needed_bytes);
  if (!behind) {
    return tl::unexpected(behind.error());
  }
  const std::uint64_t slice = needed_bytes / static_cast<std::uint64_t>(std::max<std::int64_t>(header.size[2], 1));
  if (!header.tags_follow && slice > 0 && *behind >= slice) {
    const std::string more = *behind % slice == 0
                                 ? std::to_string(*behind / slice) + " slices"
                                 : std::to_string(*behind) + " bytes (a slice has " + std::to_string(slice) + ")";
    return base::failure(data.file.string() + ": holds " + more +
                         " more than its header states: is it the header of another image?");
  }
  if (*behind > 0) {
    header.notes.push_back(data.file.string() + ": " + std::to_string(*behind) +
                           " bytes behind its voxels are not read");
  }
  return {};
}

FileHead read_file_head(const std::filesystem::path &path, std::size_t bytes) {
  // zlib reads uncompressed files unchanged.
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "rb"), gzclose);
  FileHead out;
  if (file) {
    out.bytes.resize(bytes);
    out.bytes.resize(
        static_cast<std::size_t>(std::max(0, gzread(file.get(), out.bytes.data(), static_cast<unsigned>(bytes)))));
    out.compressed = gzdirect(file.get()) == 0;
  }
  return out;
}

base::Result<TextHeader> read_text_header(const std::filesystem::path &path, bool (*ends)(std::string_view line)) {
  std::ifstream in(path, std::ios::binary);
  if (!in) {
    return base::failure(path.string() + ": cannot be read");
  }
  TextHeader out;
  std::string line;
  while (out.bytes < kMaxHeaderBytes && std::getline(in, line)) {
    out.bytes += line.size() + (in.eof() ? 0 : 1);
    if (line.find('\0') != std::string::npos) {
      break; // data
    }
    const std::string_view text = base::trimmed(line);
    out.lines.emplace_back(text);
    if (ends(text)) {
      return out;
    }
  }
  return base::failure(path.string() + ": is not whole: its header does not end");
}

std::vector<double> header_numbers(std::string_view text) {
  std::vector<double> out;
  constexpr std::string_view kBetween = " \t,()\"";
  for (std::size_t at = text.find_first_not_of(kBetween); at != std::string_view::npos;
       at = text.find_first_not_of(kBetween, at)) {
    const std::size_t end = std::min(text.find_first_of(kBetween, at), text.size());
    const auto value = base::parsed_number<double>(text.substr(at, end - at));
    if (!value) {
      return {};
    }
    out.push_back(*value);
    at = end;
  }
  return out;
}

} // namespace bregma::casefile
