// The structure of DICOM files: whole, or refused.
#include "casefile/volumes/dicom_file.hpp"

#include <gtest/gtest.h>
#include <zlib.h>

#include "tests/unit/volumes/dicom_bytes.hpp"
#include "tests/unit/volumes/files.hpp"

namespace bregma::casefile {
namespace {

using test::item;
using test::kItemEnd;
using test::kSequenceEnd;
using test::little;
using test::long_element;
using test::short_element;
using test::tag;

// A slice of 2 x 3 pixels of 16 bits, with sequences of stated and of undefined length.
std::string slice(const std::string &pixels, const std::string &syntax = "1.2.840.10008.1.2.1") {
  const std::string uid = syntax + std::string(syntax.size() % 2, '\0');
  const std::string nested = short_element(0x0008, 0x0060, "CS", "MR");
  return std::string(128, '\0') + "DICM" + short_element(0x0002, 0x0010, "UI", uid) +
         long_element(0x0008, 0x1140, "SQ", 0xFFFFFFFF, item(0xFFFFFFFF, nested + kItemEnd) + kSequenceEnd) +
         long_element(0x0008, 0x1250, "SQ", 18, item(10, nested)) + short_element(0x0028, 0x0002, "US", little(1, 2)) +
         short_element(0x0028, 0x0010, "US", little(2, 2)) + short_element(0x0028, 0x0011, "US", little(3, 2)) +
         short_element(0x0028, 0x0100, "US", little(16, 2)) + pixels;
}

const std::string kPlainPixels = long_element(0x7FE0, 0x0010, "OW", 12, std::string(12, '\1'));
const std::string kFragments =
    long_element(0x7FE0, 0x0010, "OB", 0xFFFFFFFF, item(0, "") + item(6, "jpeg..") + kSequenceEnd);

TEST(DicomFile, IsWholeOnlyWithItsLastByte) {
  const test::TemporaryFolder folder;
  const std::string jpeg = "1.2.840.10008.1.2.4.70";
  for (const auto &[whole, before_pixels, compressed] : {std::tuple(slice(kPlainPixels), slice("").size(), false),
                                                         {slice(kFragments, jpeg), slice("", jpeg).size(), true}}) {
    test::write_bytes(folder / "whole.dcm", whole);
    const auto read = read_dicom_file(folder / "whole.dcm");
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_TRUE(read->has_pixels);
    EXPECT_EQ(read->compressed, compressed);
    EXPECT_EQ(read->rows * read->columns, 6U);
    for (std::size_t size = 132; size < whole.size(); ++size) {
      test::write_bytes(folder / "cut.dcm", whole.substr(0, size));
      const auto cut = read_dicom_file(folder / "cut.dcm");
      // Between two elements a file may end: it then has no pixels, and is no image.
      EXPECT_TRUE(!cut || !cut->has_pixels) << size;
      EXPECT_TRUE(!cut || size <= before_pixels) << size;
    }
  }
}

TEST(DicomFile, FewerPixelsThanStatedAreRefused) {
  const test::TemporaryFolder folder;
  test::write_bytes(folder / "few.dcm", slice(long_element(0x7FE0, 0x0010, "OW", 10, std::string(10, '\1'))));
  const auto few = read_dicom_file(folder / "few.dcm");
  ASSERT_FALSE(few);
  EXPECT_NE(few.error().message.find("it holds 10 bytes of pixels, its header asks for 12"), std::string::npos);
}

// A header of fewer rows is that of another image.
TEST(DicomFile, ARowOfPixelsMoreThanStatedIsRefused) {
  const test::TemporaryFolder folder;
  for (const auto &[bytes, sound] : {std::pair(12U, true), {14U, true}, {18U, false}}) {
    test::write_bytes(folder / "a.dcm", slice(long_element(0x7FE0, 0x0010, "OW", bytes, std::string(bytes, '\1'))));
    const auto read = read_dicom_file(folder / "a.dcm");
    EXPECT_EQ(read.has_value(), sound) << bytes;
    EXPECT_TRUE(read || read.error().message.find(
                            "holds 18 bytes of pixels, its header asks for 12, for 3 x 2 pixels") != std::string::npos)
        << read.error().message;
  }
}

TEST(DicomFile, ADeflatedDataSetIsLookedInto) {
  const test::TemporaryFolder folder;
  const std::string syntax = "1.2.840.10008.1.2.1.99";
  const std::string whole = slice(kPlainPixels, syntax);
  const std::size_t begin = 132 + short_element(0x0002, 0x0010, "UI", syntax).size();
  z_stream stream{};
  ASSERT_EQ(deflateInit2(&stream, 9, Z_DEFLATED, -MAX_WBITS, 9, Z_DEFAULT_STRATEGY), Z_OK);
  std::string data = whole.substr(begin);
  std::string packed(1000, '\0');
  stream.next_in = reinterpret_cast<Bytef *>(data.data()); // NOLINT
  stream.avail_in = static_cast<uInt>(data.size());
  stream.next_out = reinterpret_cast<Bytef *>(packed.data()); // NOLINT
  stream.avail_out = static_cast<uInt>(packed.size());
  ASSERT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
  packed.resize(packed.size() - stream.avail_out);
  deflateEnd(&stream);
  test::write_bytes(folder / "a.dcm", whole.substr(0, begin) + packed);
  const auto read = read_dicom_file(folder / "a.dcm");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_TRUE(read->has_pixels);
  EXPECT_EQ(read->pixel_bytes, 12U);
  for (std::size_t size = 0; size < packed.size(); ++size) {
    test::write_bytes(folder / "a.dcm", whole.substr(0, begin) + packed.substr(0, size));
    EXPECT_FALSE(read_dicom_file(folder / "a.dcm")) << size;
  }
}

TEST(DicomFile, PaddingAtTheEndIsAllowed) {
  const test::TemporaryFolder folder;
  test::write_bytes(folder / "padded.dcm", slice(kPlainPixels) + std::string(64, '\0'));
  EXPECT_TRUE(read_dicom_file(folder / "padded.dcm"));
}

} // namespace
} // namespace bregma::casefile
