// DICOM part 5, section 7 (data set, encoding, nested sequences), and part 10, section 7 (file format).
#include "casefile/volumes/dicom_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include <tl/expected.hpp>
#include <zlib.h>

#include "base/text.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kPreamble = 132; // with the mark
constexpr std::uint32_t kUndefined = 0xFFFFFFFF;
constexpr int kMaxDepth = 32; // of nested sequences

struct Tag {
  std::uint16_t group = 0, element = 0;
  friend bool operator==(const Tag &, const Tag &) = default;
};
constexpr Tag kSharedGroups{0x5200, 0x9229}, kFrameGroups{0x5200, 0x9230}, kPlanePosition{0x0020, 0x9113},
    kPlaneOrientation{0x0020, 0x9116}, kPixelMeasures{0x0028, 0x9110}, kValueTransformation{0x0028, 0x9145};
constexpr std::size_t kMaxText = 1024; // bytes of an element's text; no more are read
constexpr std::uint64_t kMaxFrames = 100'000;
constexpr Tag kItem{0xFFFE, 0xE000}, kItemEnd{0xFFFE, 0xE00D}, kSequenceEnd{0xFFFE, 0xE0DD}, kPixels{0x7FE0, 0x0010},
    kTransferSyntax{0x0002, 0x0010}, kFrameCount{0x0028, 0x0008}, kSeries{0x0020, 0x000E};

struct Encoding {
  bool explicit_vr = true;
  bool big_endian = false;
};

struct ElementHeader {
  Tag tag;
  std::array<char, 2> vr{};
  std::uint32_t length = 0;
};

std::string name_of(const Tag &tag) {
  char out[16];
  (void)std::snprintf(out, sizeof out, "(%04x,%04x)", tag.group, tag.element);
  return out;
}

// NaN if they are not `Count` numbers.
template <int Count> Eigen::Matrix<double, Count, 1> numbers_of(std::string_view text) {
  using Numbers = Eigen::Matrix<double, Count, 1>;
  const std::vector<double> values = decimal_numbers(text);
  return values.size() == Count ? Numbers(Eigen::Map<const Numbers>(values.data()))
                                : Numbers(Numbers::Constant(std::numeric_limits<double>::quiet_NaN()));
}

template <class T> using Step = tl::expected<T, std::string>; // the problem

class Walk {
public:
  // begin: of the first element.
  Walk(std::istream &in, std::uint64_t size, std::uint64_t begin) : in_(in), size_(size), at_(begin) {}

  Step<DicomFile> run() {
    auto syntax = read_meta();
    if (!syntax) {
      return tl::unexpected(syntax.error());
    }
    if (at_ >= size_) { // on which GDCM ends the process
      return tl::unexpected(std::string("it ends before its data set"));
    }
    if (*syntax == "1.2.840.10008.1.2.1.99") { // deflated
      return inflated().and_then([](const std::string &bytes) {
        std::istringstream in(bytes);
        return Walk(in, bytes.size(), 0).data_set({.explicit_vr = true, .big_endian = false});
      });
    }
    return data_set({*syntax != "1.2.840.10008.1.2", *syntax == "1.2.840.10008.1.2.2"});
  }

private:
  Step<DicomFile> data_set(const Encoding &encoding) {
    while (at_ < size_) {
      if (padding_follows()) {
        break;
      }
      if (auto element = take_element(encoding, 0, true); !element) {
        return tl::unexpected(element.error());
      }
    }
    complete_frames();
    return out_;
  }

  // The data set behind group 2, which is one stream without a checksum.
  Step<std::string> inflated() {
    constexpr std::uint64_t kMost = std::uint64_t{1} << 30;
    std::string packed(static_cast<std::size_t>(size_ - at_), '\0');
    read(packed.data(), packed.size());
    z_stream stream{};
    if (inflateInit2(&stream, -MAX_WBITS) != Z_OK) {
      return tl::unexpected(std::string("zlib cannot be used"));
    }
    stream.next_in = reinterpret_cast<Bytef *>(packed.data());
    stream.avail_in = static_cast<uInt>(std::min<std::size_t>(packed.size(), std::numeric_limits<uInt>::max()));
    std::string out;
    std::array<char, 1 << 16> block{};
    int state = Z_OK;
    while (state == Z_OK && out.size() < kMost) {
      stream.next_out = reinterpret_cast<Bytef *>(block.data());
      stream.avail_out = static_cast<uInt>(block.size());
      state = inflate(&stream, Z_NO_FLUSH);
      out.append(block.data(), block.size() - stream.avail_out);
    }
    inflateEnd(&stream);
    return state == Z_STREAM_END ? Step<std::string>(std::move(out))
                                 : tl::unexpected(std::string("its deflated data set does not end"));
  }

  // Group 2, always explicit and little endian: the transfer syntax.
  Step<std::string> read_meta() {
    std::string syntax;
    while (at_ < size_) {
      const std::uint64_t begin = at_;
      const auto header = take_header({});
      if (!header) {
        return tl::unexpected(header.error());
      }
      if (header->tag.group != 2) {
        at_ = begin;
        break;
      }
      if (auto fits = check_fits(*header); !fits) {
        return tl::unexpected(fits.error());
      }
      if (header->tag == kTransferSyntax && header->length < 100) {
        syntax.resize(header->length);
        read(syntax.data(), syntax.size());
        syntax.resize(std::min(syntax.find_first_of(std::string_view(" \0", 2)), syntax.size()));
      }
      at_ += header->length;
    }
    if (syntax.empty() && at_ == 0) { // no mark and no group 2: explicit if the first element has a type in letters
      std::array<char, 8> first{};
      read(first.data(), std::min<std::size_t>(first.size(), size_));
      const auto is_letter = [](char c) { return c >= 'A' && c <= 'Z'; };
      return is_letter(first[4]) && is_letter(first[5]) ? "1.2.840.10008.1.2.1" : "1.2.840.10008.1.2";
    }
    return syntax.empty() ? Step<std::string>(tl::unexpected(std::string("it states no transfer syntax"))) : syntax;
  }

  // One element with its content; true if it ends a sequence or an item.
  Step<bool> take_element(const Encoding &encoding, int depth, bool top) {
    const auto header = take_header(encoding);
    if (!header) {
      return tl::unexpected(header.error());
    }
    if (header->tag == kItemEnd || header->tag == kSequenceEnd) {
      return true;
    }
    const auto no_end = [] { return false; };
    if (header->length == kUndefined) {
      // Pixels in fragments, a sequence, or an unknown element, which is a sequence of implicit elements.
      const bool unknown = header->vr == std::array{'U', 'N'};
      if (header->tag == kPixels && top) {
        out_.has_pixels = out_.compressed = true;
      }
      return take_sequence(unknown ? Encoding{false, encoding.big_endian} : encoding, header->tag, depth + 1,
                           std::nullopt)
          .map(no_end);
    }
    if (auto fits = check_fits(*header); !fits) {
      return tl::unexpected(fits.error());
    }
    if (is_looked_into(header->tag, top)) {
      return take_sequence(encoding, header->tag, depth + 1, at_ + header->length).map(no_end);
    }
    if (top) {
      keep(*header, encoding);
    } else if (groups_ != Tag{}) {
      keep_of_frame(*header);
    }
    at_ += header->length;
    return false;
  }

  // The functional groups of frames, whose sequences and items may state their lengths.
  [[nodiscard]] bool is_looked_into(const Tag &tag, bool top) const {
    return top ? tag == kSharedGroups || tag == kFrameGroups
               : groups_ != Tag{} && (tag == kPlanePosition || tag == kPlaneOrientation || tag == kPixelMeasures ||
                                      tag == kValueTransformation);
  }

  // Items up to the end of the sequence. An item of stated length is skipped as a whole, but for functional groups.
  Step<void> take_sequence(const Encoding &encoding, const Tag &of, int depth, std::optional<std::uint64_t> end) {
    if (depth > kMaxDepth) {
      return tl::unexpected(std::string("its sequences are nested too deeply"));
    }
    const bool is_groups = depth == 1 && (of == kSharedGroups || of == kFrameGroups);
    const Tag outer = std::exchange(macro_, of);
    groups_ = is_groups ? of : groups_;
    for (;;) {
      if (end && at_ >= *end) {
        if (at_ > *end) {
          return tl::unexpected("an item of the sequence " + name_of(of) + " is longer than the sequence");
        }
        break;
      }
      const auto item = take_header({.explicit_vr = false, .big_endian = encoding.big_endian});
      if (!item) {
        return tl::unexpected("the sequence " + name_of(of) + " does not end");
      }
      if (item->tag == kSequenceEnd) {
        break;
      }
      if (item->tag != kItem) {
        return tl::unexpected("the sequence " + name_of(of) + " holds " + name_of(item->tag) + " instead of an item");
      }
      if (of == kPixels) {
        ++out_.fragments;
      }
      if (is_groups && of == kFrameGroups) {
        if (out_.frames.size() >= kMaxFrames) {
          return tl::unexpected("it holds more than " + std::to_string(kMaxFrames) + " frames");
        }
        out_.frames.emplace_back();
      }
      if (auto taken = take_item(encoding, *item, depth); !taken) {
        return taken;
      }
    }
    macro_ = outer;
    groups_ = is_groups ? Tag{} : groups_;
    return {};
  }

  Step<void> take_item(const Encoding &encoding, const ElementHeader &item, int depth) {
    if (item.length == kUndefined) {
      for (Step<bool> ended = false; !*ended;) {
        ended = take_element(encoding, depth, false);
        if (!ended) {
          return tl::unexpected(ended.error());
        }
      }
      return {};
    }
    if (auto fits = check_fits(item); !fits) {
      return fits;
    }
    const std::uint64_t end = at_ + item.length;
    if (groups_ == Tag{}) {
      at_ = end;
      return {};
    }
    while (at_ < end) {
      if (auto taken = take_element(encoding, depth, false); !taken) {
        return tl::unexpected(taken.error());
      }
    }
    return at_ == end ? Step<void>()
                      : tl::unexpected(std::string("an item of a functional group is longer than it states"));
  }

  Step<ElementHeader> take_header(const Encoding &encoding) {
    const auto cut = [this] {
      return tl::unexpected("it ends within the header of an element, at byte " + std::to_string(at_));
    };
    ElementHeader out;
    std::array<char, 8> bytes{};
    if (size_ - at_ < bytes.size()) {
      return cut();
    }
    read(bytes.data(), bytes.size());
    at_ += bytes.size();
    out.tag = {number16(bytes.data(), encoding), number16(bytes.data() + 2, encoding)};
    out.vr = {bytes[4], bytes[5]};
    if (!encoding.explicit_vr || out.tag.group == kItem.group) {
      out.length = number32(bytes.data() + 4, encoding);
      return out;
    }
    constexpr std::array<std::string_view, 13> kLong{"OB", "OW", "OF", "OD", "OL", "OV", "SQ",
                                                     "UC", "UR", "UT", "UN", "SV", "UV"};
    if (std::find(kLong.begin(), kLong.end(), std::string_view(out.vr.data(), 2)) == kLong.end()) {
      out.length = number16(bytes.data() + 6, encoding);
      return out;
    }
    if (size_ - at_ < 4) {
      return cut();
    }
    read(bytes.data(), 4);
    at_ += 4;
    out.length = number32(bytes.data(), encoding);
    return out;
  }

  [[nodiscard]] Step<void> check_fits(const ElementHeader &header) const {
    return header.length <= size_ - at_
               ? Step<void>()
               : tl::unexpected("the element " + name_of(header.tag) + " has " + std::to_string(header.length) +
                                " bytes, the file holds " + std::to_string(size_ - at_) + " of them");
  }

  void keep(const ElementHeader &header, const Encoding &encoding) {
    if (header.tag == kPixels) {
      out_.has_pixels = true;
      out_.pixel_bytes = header.length;
    }
    if (header.tag == kFrameCount) {
      const double count = numbers_of<1>(text_of(header))[0];
      out_.frame_count = count >= 0.0 && count <= 4e9 ? static_cast<std::uint64_t>(count) : 0;
      return;
    }
    for (const auto &[tag, text] : {std::pair(kSeries, &out_.series),
                                    {Tag{0x0010, 0x0010}, &out_.patient_name},
                                    {Tag{0x0010, 0x0020}, &out_.patient_id},
                                    {Tag{0x0020, 0x0052}, &out_.frame_of_reference}}) {
      if (header.tag == tag) {
        const std::string padded = text_of(header);
        *text = base::trimmed(padded.substr(0, padded.find('\0')));
        return;
      }
    }
    for (const auto &[tag, number] :
         {std::pair(Tag{0x0020, 0x0013}, &out_.instance), {Tag{0x0020, 0x1002}, &out_.images_in_acquisition}}) {
      if (header.tag == tag) {
        if (const double stated = numbers_of<1>(text_of(header))[0]; std::isfinite(stated)) {
          *number = stated;
        }
        return;
      }
    }
    if (header.tag.group != 0x0028 || header.length < 2) {
      return;
    }
    std::array<char, 2> bytes{};
    read(bytes.data(), bytes.size());
    const std::uint64_t value = number16(bytes.data(), encoding);
    switch (header.tag.element) {
    case 0x0002:
      out_.samples = value;
      break;
    case 0x0010:
      out_.rows = value;
      break;
    case 0x0011:
      out_.columns = value;
      break;
    case 0x0100:
      out_.bits_allocated = value;
      break;
    default:
      break;
    }
  }

  void keep_of_frame(const ElementHeader &header) {
    DicomFrame &frame = groups_ == kSharedGroups ? shared_ : out_.frames.back();
    if (macro_ == kPlanePosition && header.tag == Tag{0x0020, 0x0032}) {
      frame.position_mm = numbers_of<3>(text_of(header));
    } else if (macro_ == kPlaneOrientation && header.tag == Tag{0x0020, 0x0037}) {
      frame.orientation = numbers_of<6>(text_of(header));
    } else if (macro_ == kPixelMeasures && header.tag == Tag{0x0028, 0x0030}) {
      frame.spacing_mm = numbers_of<2>(text_of(header));
    } else if (macro_ == kValueTransformation && header.tag == Tag{0x0028, 0x1052}) {
      frame.intercept = numbers_of<1>(text_of(header))[0];
    } else if (macro_ == kValueTransformation && header.tag == Tag{0x0028, 0x1053}) {
      frame.slope = numbers_of<1>(text_of(header))[0];
    }
  }

  // What is the same for all frames.
  void complete_frames() {
    for (DicomFrame &frame : out_.frames) {
      frame.position_mm = frame.position_mm ? frame.position_mm : shared_.position_mm;
      frame.orientation = frame.orientation ? frame.orientation : shared_.orientation;
      frame.spacing_mm = frame.spacing_mm ? frame.spacing_mm : shared_.spacing_mm;
      frame.slope = frame.slope ? frame.slope : shared_.slope;
      frame.intercept = frame.intercept ? frame.intercept : shared_.intercept;
    }
  }

  // The value of an element of text, with its padding.
  std::string text_of(const ElementHeader &header) {
    std::string out(header.length <= kMaxText ? header.length : 0, '\0');
    read(out.data(), out.size());
    return out;
  }

  // Zeros that some programs and archives add.
  [[nodiscard]] bool padding_follows() {
    std::array<char, 8> bytes{};
    const auto left = static_cast<std::size_t>(std::min<std::uint64_t>(size_ - at_, bytes.size()));
    read(bytes.data(), left);
    return std::all_of(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(left), [](char c) { return c == 0; });
  }

  // Reads without moving on.
  void read(char *to, std::size_t count) {
    in_.clear();
    in_.seekg(static_cast<std::streamoff>(at_));
    in_.read(to, static_cast<std::streamsize>(count));
  }

  static std::uint16_t number16(const char *bytes, const Encoding &encoding) {
    const auto first = static_cast<unsigned char>(bytes[encoding.big_endian ? 0 : 1]);
    const auto second = static_cast<unsigned char>(bytes[encoding.big_endian ? 1 : 0]);
    return static_cast<std::uint16_t>(first << 8 | second);
  }
  static std::uint32_t number32(const char *bytes, const Encoding &encoding) {
    const std::uint32_t low = number16(bytes + (encoding.big_endian ? 2 : 0), encoding);
    const std::uint32_t high = number16(bytes + (encoding.big_endian ? 0 : 2), encoding);
    return high << 16 | low;
  }

  std::istream &in_;
  std::uint64_t size_;
  std::uint64_t at_;
  DicomFile out_;
  Tag groups_{}; // the functional groups that are being read, if any
  Tag macro_{};  // the innermost sequence
  DicomFrame shared_;
};

} // namespace

std::vector<double> decimal_numbers(std::string_view text) {
  text = text.substr(0, text.find_last_not_of('\0') + 1);
  std::vector<double> out;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find('\\', begin), text.size());
    std::string_view cell = base::trimmed(text.substr(begin, end - begin));
    cell.remove_prefix(cell.starts_with('+') ? 1 : 0);
    const auto value = base::parsed_number<double>(cell);
    if (!value || !std::isfinite(*value)) {
      return {};
    }
    out.push_back(*value);
    begin = end + 1;
  }
  return out;
}

bool is_dicom_file(const fs::path &file) {
  std::ifstream in(file, std::ios::binary);
  std::array<char, kPreamble> head{};
  in.read(head.data(), head.size());
  return in && std::string_view(head.data() + 128, 4) == "DICM";
}

base::Result<DicomFile> read_dicom_file(const fs::path &file) {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(file, error);
  std::ifstream in(file, std::ios::binary);
  if (error || !in) {
    return base::failure(file.string() + ": cannot be read");
  }
  const auto walked = Walk(in, size, is_dicom_file(file) ? kPreamble : 0).run();
  if (!walked) {
    return base::failure(file.string() + ": is not whole, or damaged: " + walked.error());
  }
  const double bits = static_cast<double>(walked->rows * walked->columns) * static_cast<double>(walked->samples) *
                      static_cast<double>(walked->bits_allocated) * static_cast<double>(walked->frame_count);
  const double needed = std::ceil(bits / 8.0);
  if (walked->has_pixels && !walked->compressed && static_cast<double>(walked->pixel_bytes) < needed) {
    std::array<char, 32> text{};
    (void)std::snprintf(text.data(), text.size(), "%.0f", needed);
    return base::failure(file.string() + ": is not whole: it holds " + std::to_string(walked->pixel_bytes) +
                         " bytes of pixels, its header asks for " + text.data());
  }
  // One byte pads an odd number of them.
  const double row = static_cast<double>(walked->columns * walked->samples * walked->bits_allocated) / 8.0;
  if (const double more = static_cast<double>(walked->pixel_bytes) - needed;
      walked->has_pixels && !walked->compressed && more > 1.0 && more >= row) {
    std::array<char, 96> text{};
    (void)std::snprintf(text.data(), text.size(), "%.0f, for %.0f x %.0f pixels", needed,
                        static_cast<double>(walked->columns), static_cast<double>(walked->rows));
    return base::failure(file.string() + ": holds " + std::to_string(walked->pixel_bytes) +
                         " bytes of pixels, its header asks for " + text.data() + ": is it that of another image?");
  }
  // The first item is the table of offsets. A deflated data set has none.
  if (walked->fragments > 0 && walked->fragments - 1 < walked->frame_count) {
    return base::failure(file.string() + ": is not whole: it holds " + std::to_string(walked->fragments - 1) +
                         " fragments of pixels for " + std::to_string(walked->frame_count) + " frames");
  }
  return *walked;
}

} // namespace bregma::casefile
