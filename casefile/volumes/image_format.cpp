// Which image a file holds, by its content.
#include "base/text.hpp"
#include "casefile/volumes/image_header.hpp"

namespace bregma::casefile {

ImageFormat image_format_of(const std::filesystem::path &path) {
  const FileHead head = read_file_head(path, 1024);
  const std::string_view text(head.bytes);
  constexpr std::size_t kDicomMark = 128;
  const std::string name = base::lower(path.filename().string());
  if (name.ends_with(".img") || name.ends_with(".img.gz")) { // voxels without a header
    return ImageFormat::kNifti;
  }
  // The length of the header, of NIfTI-1 and NIfTI-2, in either byte order.
  for (const std::string_view start : {std::string_view("\x5C\x01\0\0", 4), std::string_view("\0\0\x01\x5C", 4),
                                       std::string_view("\x1C\x02\0\0", 4), std::string_view("\0\0\x02\x1C", 4)}) {
    if (text.starts_with(start)) {
      return ImageFormat::kNifti;
    }
  }
  if (text.starts_with(std::string_view("\0\0\0\x01", 4))) { // the version, big-endian
    return ImageFormat::kMgh;
  }
  if (head.compressed) { // only those two may be, as a whole
    return ImageFormat::kUnknown;
  }
  if (text.starts_with("NRRD")) {
    return ImageFormat::kNrrd;
  }
  if (text.size() > kDicomMark && text.substr(kDicomMark).starts_with("DICM")) {
    return ImageFormat::kDicom;
  }
  const bool meta =
      text.starts_with("ObjectType") || text.starts_with("NDims") || text.find("\nNDims") != std::string_view::npos;
  return meta ? ImageFormat::kMeta : ImageFormat::kUnknown;
}

base::Result<ImageHeader> read_image_header(const std::filesystem::path &path, ImageFormat format,
                                            std::optional<Space> space) {
  switch (format) {
  case ImageFormat::kNifti:
    return read_nifti_header(path);
  case ImageFormat::kMgh:
    return read_mgh_header(path);
  case ImageFormat::kNrrd:
    return read_nrrd_header(path, space);
  case ImageFormat::kMeta:
    return read_meta_header(path, space);
  case ImageFormat::kDicom:
    return base::failure(path.string() + (base::lower(path.filename().string()) == "dicomdir"
                                              ? ": is the list of a DICOM medium; give the folder that it lies in"
                                              : ": is one DICOM file; give the folder of its series"));
  case ImageFormat::kUnknown:
    break;
  }
  if (const FileHead head = read_file_head(path, 1024); head.compressed && head.bytes.empty()) {
    return base::failure(path.string() + ": is not whole: its compressed data are damaged at their begin");
  }
  return base::failure(path.string() + ": is not a NIfTI, NRRD, MetaImage or MGH file that can be read");
}

} // namespace bregma::casefile
