// DICOM part 5, section 7 (data set, encoding, nested sequences), and part 10, section 7 (file format).
#include "casefile/volumes/dicom_file.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>

#include <tl/expected.hpp>

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
constexpr Tag kItem{0xFFFE, 0xE000}, kItemEnd{0xFFFE, 0xE00D}, kSequenceEnd{0xFFFE, 0xE0DD}, kPixels{0x7FE0, 0x0010},
    kTransferSyntax{0x0002, 0x0010};

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

template <class T> using Step = tl::expected<T, std::string>; // the problem

class Walk {
public:
  // begin: of the first element.
  Walk(std::ifstream &in, std::uint64_t size, std::uint64_t begin) : in_(in), size_(size), at_(begin) {}

  Step<DicomFile> run() {
    auto syntax = read_meta();
    if (!syntax) {
      return tl::unexpected(syntax.error());
    }
    if (at_ >= size_) { // on which GDCM ends the process
      return tl::unexpected(std::string("it ends before its data set"));
    }
    if (*syntax == "1.2.840.10008.1.2.1.99") { // deflated
      out_.has_pixels = true;
      out_.compressed = true;
      return out_;
    }
    const Encoding encoding{*syntax != "1.2.840.10008.1.2", *syntax == "1.2.840.10008.1.2.2"};
    while (at_ < size_) {
      if (padding_follows()) {
        break;
      }
      if (auto element = take_element(encoding, 0, true); !element) {
        return tl::unexpected(element.error());
      }
    }
    return out_;
  }

private:
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
    if (header->length == kUndefined) {
      // Pixels in fragments, a sequence, or an unknown element, which is a sequence of implicit elements.
      const bool unknown = header->vr == std::array{'U', 'N'};
      if (header->tag == kPixels && top) {
        out_.has_pixels = out_.compressed = true;
      }
      return take_sequence(unknown ? Encoding{false, encoding.big_endian} : encoding, header->tag, depth + 1).map([] {
        return false;
      });
    }
    if (auto fits = check_fits(*header); !fits) {
      return tl::unexpected(fits.error());
    }
    if (top) {
      keep(*header, encoding);
    }
    at_ += header->length;
    return false;
  }

  // Items up to the end of the sequence. An item of stated length is skipped as a whole.
  Step<void> take_sequence(const Encoding &encoding, const Tag &of, int depth) {
    if (depth > kMaxDepth) {
      return tl::unexpected(std::string("its sequences are nested too deeply"));
    }
    for (;;) {
      const auto item = take_header({.explicit_vr = false, .big_endian = encoding.big_endian});
      if (!item) {
        return tl::unexpected("the sequence " + name_of(of) + " does not end");
      }
      if (item->tag == kSequenceEnd) {
        return {};
      }
      if (item->tag != kItem) {
        return tl::unexpected("the sequence " + name_of(of) + " holds " + name_of(item->tag) + " instead of an item");
      }
      if (item->length != kUndefined) {
        if (auto fits = check_fits(*item); !fits) {
          return fits;
        }
        at_ += item->length;
        continue;
      }
      for (Step<bool> ended = false; !*ended;) {
        ended = take_element(encoding, depth, false);
        if (!ended) {
          return tl::unexpected(ended.error());
        }
      }
    }
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

  std::ifstream &in_;
  std::uint64_t size_;
  std::uint64_t at_;
  DicomFile out_;
};

} // namespace

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
  const std::uint64_t needed = walked->rows * walked->columns * walked->samples * ((walked->bits_allocated + 7) / 8);
  if (walked->has_pixels && !walked->compressed && walked->pixel_bytes < needed) {
    return base::failure(file.string() + ": is not whole: it holds " + std::to_string(walked->pixel_bytes) +
                         " bytes of pixels, its header asks for " + std::to_string(needed));
  }
  return *walked;
}

} // namespace bregma::casefile
