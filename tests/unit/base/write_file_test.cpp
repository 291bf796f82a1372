#include "base/write_file.hpp"

#include <filesystem>

#include <gtest/gtest.h>

#include "base/read_file.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::base {
namespace {

namespace fs = std::filesystem;

std::string text_of(const fs::path &file) { return read_file(file).value_or("not read"); }

TEST(WriteFile, ReplacesTheContentAsAWhole) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "a.txt";
  ASSERT_TRUE(write_file(file, "first, which is longer"));
  ASSERT_TRUE(write_file(file, std::string("two\0bytes", 9)));
  EXPECT_EQ(text_of(file), std::string("two\0bytes", 9));
  ASSERT_TRUE(write_file(file, ""));
  EXPECT_EQ(text_of(file), "");
  EXPECT_FALSE(fs::exists(folder / "a.txt.new"));
}

TEST(WriteFile, AFullDiskHasItsOwnMessageAndCostsNothing) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "a.txt";
  ASSERT_TRUE(write_file(file, "kept"));
  fs::create_symlink("/dev/full", folder / "a.txt.new");
  const auto full = write_file(file, "more");
  ASSERT_FALSE(full);
  EXPECT_EQ(full.error().message, file.string() + ": cannot be written: the disk is full");
  EXPECT_EQ(text_of(file), "kept");
  EXPECT_FALSE(fs::exists(folder / "a.txt.new"));
  EXPECT_EQ(write_file("/dev/full", "x").error().message, "/dev/full: cannot be written: the disk is full");
  EXPECT_TRUE(write_file("/dev/null", "x")) << "a device is not replaced";
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST(WriteFile, TheReasonIsStated) {
  const test::TemporaryFolder folder;
  EXPECT_EQ(write_file(folder / "no/a.txt", "x").error().message,
            (folder / "no/a.txt").string() + ": cannot be written: No such file or directory");
  EXPECT_EQ(write_file(folder.path(), "x").error().message,
            folder.path().string() + ": cannot be written: Is a directory");
}

TEST(WriteFile, ALinkKeepsPointingToTheFile) {
  const test::TemporaryFolder folder;
  ASSERT_TRUE(write_file(folder / "real.txt", "old"));
  fs::create_symlink(folder / "real.txt", folder / "link.txt");
  ASSERT_TRUE(write_file(folder / "link.txt", "new"));
  EXPECT_TRUE(fs::is_symlink(folder / "link.txt"));
  EXPECT_EQ(text_of(folder / "real.txt"), "new");
}

} // namespace
} // namespace bregma::base
