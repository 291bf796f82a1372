#include "clients/casefiles/download.hpp"

#include <algorithm>
#include <numeric>
#include <random>

#include <gtest/gtest.h>

#include "base/read_file.hpp"
#include "clients/casefiles/manifest.hpp"
#include "idl/topics.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::casefiles {
namespace {

constexpr std::size_t kChunk = bregma_wire_CASE_CHUNK_BYTES;
constexpr std::int64_t kMs_ns = 1'000'000;

std::string content_of(std::size_t bytes) {
  std::mt19937 random(7);
  std::string out(bytes, '\0');
  std::generate(out.begin(), out.end(), [&] { return static_cast<char>(random()); });
  return out;
}

std::span<const std::byte> chunk_of(const std::string &content, std::uint64_t chunk) {
  const auto bytes = std::as_bytes(std::span(content));
  return bytes.subspan(chunk * kChunk, std::min(kChunk, bytes.size() - chunk * kChunk));
}

bool give(Download &download, const std::string &content, std::uint64_t chunk) {
  return download.accept(chunk, crc32_of(chunk_of(content, chunk)), chunk_of(content, chunk));
}

class DownloadTest : public ::testing::Test {
protected:
  test::TemporaryFolder folder_;
  std::string content_ = content_of(50 * kChunk + 123);
  Download download_ = *Download::begin({sha256(content_), content_.size()}, folder_ / "file");
};

TEST_F(DownloadTest, ALossyTransferInAnyOrderEndsWithTheFile) {
  std::mt19937 random(3);
  std::int64_t now_ns = kMs_ns;
  std::uint64_t asked = 0;
  while (!download_.complete()) {
    std::vector<std::uint64_t> chunks;
    while (const auto ask = download_.ask(now_ns)) {
      EXPECT_LE(ask->count, Download::kWindow);
      for (std::uint64_t i = 0; i < ask->count; ++i) {
        chunks.push_back(ask->first + i);
      }
    }
    asked += chunks.size();
    std::shuffle(chunks.begin(), chunks.end(), random);
    for (const std::uint64_t chunk : chunks) {
      if (random() % 4 != 0) {
        EXPECT_TRUE(give(download_, content_, chunk));
        EXPECT_FALSE(give(download_, content_, chunk)) << "twice";
      }
    }
    now_ns += Download::kPatience_ns;
    ASSERT_LT(asked, 1000U);
  }
  EXPECT_EQ(download_.received_bytes(), content_.size());
  EXPECT_FALSE(download_.ask(now_ns));
  ASSERT_TRUE(download_.finish());
  EXPECT_EQ(*base::read_file(folder_ / "file"), content_);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "file.part"));
}

TEST_F(DownloadTest, AtMostAWindowIsUnderWay) {
  std::uint64_t asked = 0;
  while (const auto ask = download_.ask(kMs_ns)) {
    asked += ask->count;
  }
  EXPECT_EQ(asked, Download::kWindow);
  EXPECT_TRUE(give(download_, content_, 0));
  EXPECT_FALSE(download_.ask(2 * kMs_ns)) << "half a window at a time";
  for (std::uint64_t i = 1; i < Download::kWindow / 2; ++i) {
    EXPECT_TRUE(give(download_, content_, i));
  }
  EXPECT_EQ(download_.ask(2 * kMs_ns)->count, Download::kWindow / 2);
}

TEST_F(DownloadTest, DamagedAndForeignChunksAreRefused) {
  const auto good = chunk_of(content_, 0);
  EXPECT_FALSE(download_.accept(0, crc32_of(good) ^ 1U, good));
  EXPECT_FALSE(download_.accept(0, crc32_of(good.first(100)), good.first(100)));
  EXPECT_FALSE(download_.accept(51, crc32_of(good), good));
  EXPECT_FALSE(download_.accept(~std::uint64_t{0}, crc32_of(good), good));
  EXPECT_EQ(download_.received_bytes(), 0U);
}

TEST_F(DownloadTest, AWholeFileWithAnotherHashIsNotKept) {
  auto other = *Download::begin({sha256("something else"), content_.size()}, folder_ / "other");
  for (std::uint64_t i = 0; i <= 50; ++i) {
    EXPECT_TRUE(give(other, content_, i));
  }
  EXPECT_EQ(other.finish().error().message, "a file of the case arrived with another checksum than it was offered");
  EXPECT_FALSE(std::filesystem::exists(folder_ / "other"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "other.part"));
}

TEST(DownloadSize, NoFileAndOneThatIsTooLargeAreRefused) {
  const test::TemporaryFolder folder;
  EXPECT_FALSE(Download::begin({{}, 0}, folder / "file"));
  EXPECT_FALSE(Download::begin({{}, std::uint64_t{1} << 40}, folder / "file"));
  EXPECT_FALSE(Download::begin({{}, 10}, folder / "missing" / "file"));
}

const std::string kHash(64, 'a');

std::string manifest(const std::string &files) {
  return R"({"id": "c1", "image": {"sha256": ")" + kHash + R"(", "bytes": 10}, "meshes": [)" + files + "]}";
}

TEST(ManifestTest, FilesAndTheirAddresses) {
  const auto read = read_manifest(manifest(R"({"file": "scalp", "sha256": ")" + kHash + R"(", "bytes": 4})"));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->id, "c1");
  ASSERT_EQ(read->files.size(), 2U);
  EXPECT_EQ(read->files.at("mesh/scalp").bytes, 4U);
  EXPECT_NE(read->json.find("/mesh/scalp\""), std::string::npos);
  EXPECT_NE(read->json.find("\"hash\":\""), std::string::npos);
}

TEST(ManifestTest, WhatIsNotAManifestIsRefused) {
  for (const std::string &text :
       {std::string(), std::string("{"), std::string("[]"), std::string("{}"),
        std::string(R"({"id": 1, "meshes": []})"), std::string(R"({"id": "c", "meshes": {}})"),
        std::string(R"({"id": "c", "meshes": [7]})"),
        std::string(R"({"id": "c", "meshes": [], "image": {"bytes": 1}})"),
        std::string(R"({"id": "c", "meshes": [], "image": {"sha256": "x", "bytes": 1}})"),
        manifest(R"({"file": "a/../b", "sha256": ")" + kHash + R"(", "bytes": 4})"),
        manifest(R"({"file": "", "sha256": ")" + kHash + R"(", "bytes": 4})"),
        manifest(R"({"file": "a", "sha256": ")" + kHash + R"(", "bytes": -4})"),
        std::string(kMaxManifestBytes + 1, ' ')}) {
    EXPECT_FALSE(read_manifest(text)) << text.substr(0, 100);
  }
}

TEST(Sha256, IsThatOfTheStandard) {
  EXPECT_EQ(to_hex(sha256("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(from_hex(to_hex(sha256("abc"))), sha256("abc"));
  EXPECT_FALSE(from_hex("ba78"));
  EXPECT_FALSE(from_hex(std::string(64, 'g')));
}

} // namespace
} // namespace bregma::casefiles
