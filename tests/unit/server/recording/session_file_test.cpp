#include <cstring>
#include <fstream>
#include <iterator>

#include <gtest/gtest.h>
#include <sqlite3.h>

#include "casefile/session_file/session_file.hpp"
#include "idl/version.hpp"
#include "tests/unit/server/recording/recording_support.hpp"

namespace bregma::casefile {
namespace {

const std::string kOwnWire = wire::text_of(wire::kWireVersion);

using test::navigation;
using test::range;

std::span<const std::byte> bytes(const std::string &text) { return std::as_bytes(std::span(text)); }

SessionWriter create(const std::filesystem::path &file) {
  auto writer = SessionWriter::create(file);
  EXPECT_TRUE(writer) << writer.error().message;
  return std::move(*writer);
}

SessionReader open(const std::filesystem::path &file) {
  auto reader = SessionReader::open(file);
  EXPECT_TRUE(reader) << reader.error().message;
  return std::move(*reader);
}

void run_sql(const std::filesystem::path &file, const char *sql) {
  sqlite3 *database = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(database, sql, nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(database);
  sqlite3_close(database);
}

std::string refusal(const std::filesystem::path &file) {
  const auto reader = SessionReader::open(file);
  return reader ? std::string() : reader.error().message;
}

// At the latest while it is read.
TEST(SessionFile, AFileThatWasCutAnywhereIsRefused) {
  const test::TemporaryFolder folder;
  {
    auto writer = create(folder / "a.session");
    for (std::uint64_t i = 0; i < 100; ++i) {
      EXPECT_TRUE(writer.write(static_cast<std::int64_t>(i), navigation(i)));
    }
  }
  std::ifstream in(folder / "a.session", std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(in), {}};
  const auto refused = [&folder] {
    const auto reader = SessionReader::open(folder / "cut.session");
    return !reader || !reader->topics() || !reader->meta() ||
           !reader->each<wire::NavigationState>([](const wire::NavigationState &, std::int64_t) {});
  };
  static_cast<void>(folder.write("cut.session", whole));
  ASSERT_FALSE(refused());
  for (std::size_t size = 0; size < whole.size(); size += 1 + whole.size() / 200) {
    static_cast<void>(folder.write("cut.session", whole.substr(0, size)));
    EXPECT_TRUE(refused()) << size << " of " << whole.size() << " bytes";
  }
}

TEST(SessionFile, ReturnsEveryByteInTheOrderOfRecording) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.session";
  const std::string mesh("ply\0\n\xff binary", 13);
  {
    auto writer = create(file);
    EXPECT_TRUE(writer.set_meta("case", "colin27"));
    EXPECT_TRUE(writer.set_meta("case", "colin27 again"));
    EXPECT_TRUE(writer.attach("scalp.ply", bytes(mesh)));
    EXPECT_TRUE(writer.attach("empty", {}));
    for (std::uint64_t i = 0; i < 500; ++i) {
      EXPECT_TRUE(writer.write(static_cast<std::int64_t>(1'000 + i), navigation(i)));
      if (i % 3 == 0) {
        EXPECT_TRUE(writer.write(static_cast<std::int64_t>(2'000 + i), range(i)));
      }
    }
  }
  const auto reader = open(file);
  std::uint64_t next = 0;
  const auto number = reader.each<wire::NavigationState>([&](const wire::NavigationState &state, std::int64_t time_ns) {
    const auto expected = navigation(next);
    // Bytes are what is recorded. NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
    EXPECT_EQ(std::memcmp(&state, &expected, sizeof state), 0);
    EXPECT_EQ(time_ns, static_cast<std::int64_t>(1'000 + next));
    ++next;
  });
  EXPECT_EQ(number.value(), 500U);
  EXPECT_EQ(reader.each<wire::RangeSample>([](const auto &, std::int64_t) {}).value(), 167U);
  EXPECT_EQ(reader.each<wire::Alarm>([](const auto &, std::int64_t) {}).value(), 0U);

  const auto topics = reader.topics().value();
  ASSERT_EQ(topics.size(), 2U);
  EXPECT_EQ(topics[0].name, "NavigationState");
  EXPECT_EQ(topics[0].size, sizeof(wire::NavigationState));
  EXPECT_EQ(topics[0].count, 500U);
  EXPECT_EQ(reader.meta("case").value(), "colin27 again");
  EXPECT_EQ(reader.meta("no such key").value(), std::nullopt);
  EXPECT_EQ(reader.meta("wire").value(), kOwnWire);
  EXPECT_EQ(reader.meta("layout").value(), std::to_string(casefile::kSessionFileVersion));
  EXPECT_EQ(reader.meta()->size(), 3U);
  EXPECT_EQ(reader.attachment("scalp.ply").value(), mesh);
  EXPECT_EQ(reader.attachment("empty").value(), "");
  EXPECT_EQ(reader.attachments().value(), (std::vector<std::string>{"empty", "scalp.ply"}));
  const auto missing = reader.attachment("brain.ply");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().message, file.string() + ": has no attachment brain.ply");
}

// What the scanner's stage and the robot's tool publish can be replayed: coils, texts and unknown values included.
TEST(SessionFile, ReturnsTheScannersRegistrationAndTheRobotsTool) {
  const test::TemporaryFolder folder;
  wire::ScannerRegistration registration{};
  registration.step = bregma_wire_SCANNER_STEP_ACCEPT;
  registration.verdict = bregma_wire_SCANNER_VERDICT_FOUND;
  registration.coil_count = bregma_wire_MAX_COILS;
  wire::set_text(registration.text, "the robot is found and verified");
  registration.coils[bregma_wire_MAX_COILS - 1].outcome = bregma_wire_COIL_VERIFIES;
  registration.coils[bregma_wire_MAX_COILS - 1].scanner_mm[2] = -17.25;
  registration.accepted_T_base_scanner = wire::unknown_pose();
  wire::RobotTool tool{};
  tool.scanner_status = bregma_wire_POSE_LIVE;
  tool.T_scanner_tip = {{1, 0, 0, 0}, {1, 2, 3}};
  tool.scanner_covariance[35] = 0.25;
  {
    auto writer = create(folder / "a.session");
    for (std::int64_t i = 0; i < 3; ++i) {
      registration.revision = static_cast<std::uint32_t>(i);
      tool.frame = static_cast<std::uint64_t>(i);
      EXPECT_TRUE(writer.write(100 + i, registration));
      EXPECT_TRUE(writer.write(200 + i, tool));
    }
  }
  const auto reader = open(folder / "a.session");
  std::int64_t next = 0;
  const auto states =
      reader.each<wire::ScannerRegistration>([&](const wire::ScannerRegistration &read, std::int64_t at) {
        registration.revision = static_cast<std::uint32_t>(next);
        // Bytes are what is recorded. NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
        EXPECT_EQ(std::memcmp(&read, &registration, sizeof read), 0);
        EXPECT_EQ(at, 100 + next++);
      });
  EXPECT_EQ(states.value(), 3U);
  next = 0;
  const auto tools = reader.each<wire::RobotTool>([&](const wire::RobotTool &read, std::int64_t at) {
    tool.frame = static_cast<std::uint64_t>(next);
    EXPECT_EQ(std::memcmp(&read, &tool, sizeof read), 0); // NOLINT(bugprone-suspicious-memory-comparison)
    EXPECT_EQ(at, 200 + next++);
  });
  EXPECT_EQ(tools.value(), 3U);
}

TEST(SessionFile, ConsistsOfOneFileAfterItsWriterHasFinished) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.session";
  EXPECT_TRUE(create(file).write(1, navigation(1)));
  for (const auto &entry : std::filesystem::directory_iterator(folder.path())) {
    EXPECT_EQ(entry.path(), file);
  }
}

TEST(SessionFile, CanBeReadWhileItIsWritten) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.session";
  auto writer = create(file);
  EXPECT_TRUE(writer.write(1, navigation(1)));
  EXPECT_TRUE(writer.commit());
  EXPECT_TRUE(writer.write(2, navigation(2))); // not committed
  const auto reader = open(file);
  const auto count = [&] { return reader.each<wire::NavigationState>([](const auto &, std::int64_t) {}).value(); };
  EXPECT_EQ(count(), 1U);
  EXPECT_TRUE(writer.commit());
  EXPECT_EQ(count(), 2U);
}

TEST(SessionFile, ARolledBackTransactionLeavesNoRecordsAndTheWriterContinues) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.session";
  {
    auto writer = create(file);
    EXPECT_TRUE(writer.write(1, navigation(1))); // the topic's own row is in this transaction
    writer.rollback();
    EXPECT_TRUE(writer.write(2, range(2)));
    EXPECT_TRUE(writer.write(3, navigation(3)));
  }
  const auto reader = open(file);
  std::vector<std::uint64_t> frames;
  EXPECT_TRUE(reader.each<wire::NavigationState>(
      [&](const wire::NavigationState &state, std::int64_t) { frames.push_back(state.frame); }));
  EXPECT_EQ(frames, std::vector<std::uint64_t>{3});
}

TEST(SessionFile, IsNeverOverwrittenAndNeedsAnExistingFolder) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.session";
  EXPECT_TRUE(create(file).commit());
  const auto again = SessionWriter::create(file);
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().message, file.string() + ": exists already; a session file is never written over");
  const auto nowhere = SessionWriter::create(folder / "no/a.session");
  ASSERT_FALSE(nowhere);
  EXPECT_EQ(nowhere.error().message,
            (folder / "no/a.session").string() + ": there is no folder " + (folder / "no").string());
}

TEST(SessionFile, ADifferentLayoutOfATypeIsRejectedWithNameAndSizes) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.session";
  {
    auto writer = create(file);
    EXPECT_TRUE(writer.write("RangeSample", 1, bytes("seven b")));
    const auto other = writer.write(2, range(1));
    ASSERT_FALSE(other);
    EXPECT_EQ(other.error().message, file.string() + ": topic RangeSample holds bodies of 7 bytes, not " +
                                         std::to_string(sizeof(wire::RangeSample)));
    EXPECT_TRUE(writer.write(3, navigation(1)));
  }
  const auto reader = open(file);
  const auto read = reader.each<wire::RangeSample>([](const auto &, std::int64_t) { FAIL(); });
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().message,
            file.string() + ": topic RangeSample was recorded with 7 bytes per sample, this program's has " +
                std::to_string(sizeof(wire::RangeSample)) + ": it takes the version of Bregma that recorded it");
  EXPECT_EQ(reader.each<wire::NavigationState>([](const auto &, std::int64_t) {}).value(), 1U);
}

TEST(SessionFile, ADifferentLayoutOfTheSameSizeIsRejected) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.session";
  EXPECT_TRUE(create(file).write(1, range(1)));
  EXPECT_EQ(open(file).each<wire::RangeSample>([](const auto &, std::int64_t) {}).value(), 1U);
  run_sql(file, "UPDATE topic SET type = x'0123'");
  const auto read = open(file).each<wire::RangeSample>([](const auto &, std::int64_t) { FAIL(); });
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().message, file.string() + ": topic RangeSample was recorded with another layout of the same "
                                                  "size: it takes the version of Bregma that recorded it");
}

TEST(SessionFile, RefusesWhatItIsNot) {
  const test::TemporaryFolder folder;
  EXPECT_EQ(refusal(folder / "missing"), (folder / "missing").string() + ": there is no such file");

  const auto text = folder / "text";
  std::ofstream(text) << std::string(4'000, 'x');
  EXPECT_EQ(refusal(text), text.string() + ": file is not a database; it cannot be read as a session file");

  const auto other = folder / "other";
  run_sql(other, "CREATE TABLE t(x)");
  EXPECT_EQ(refusal(other), other.string() + ": not a session file of Bregma");

  const auto future = folder / "future";
  EXPECT_TRUE(create(future).commit());
  run_sql(future, "PRAGMA user_version=7");
  EXPECT_EQ(refusal(future), future.string() + ": session file of version 7; this program reads version 2");
  const auto before = folder / "before"; // enumerations were numbered otherwise, sizes can be the same
  EXPECT_TRUE(create(before).commit());
  run_sql(before, "PRAGMA user_version=1");
  EXPECT_EQ(refusal(before), before.string() + ": session file of version 1; this program reads version 2");
  const auto generation = folder / "generation";
  EXPECT_TRUE(create(generation).commit());
  run_sql(generation, "UPDATE meta SET value='3.1' WHERE key='wire'");
  EXPECT_EQ(refusal(generation), generation.string() + ": recorded with wire 3.1; this program reads wire " + kOwnWire +
                                     ": it takes the version of "
                                     "Bregma that recorded it");
  run_sql(generation, "DELETE FROM meta WHERE key='wire'");
  EXPECT_EQ(refusal(generation), generation.string() + ": recorded with wire (not stated); this program reads wire " +
                                     kOwnWire +
                                     ": it takes the "
                                     "version of Bregma that recorded it");
}

TEST(SessionFile, ANewFileIsBroughtToTheDiskWhileItIsWritten) {
  const test::TemporaryFolder folder;
  const auto file = folder / "new.bregma";
  auto writer = SessionWriter::create(file);
  ASSERT_TRUE(writer);
  auto log = SessionLog::open(file);
  ASSERT_TRUE(log);
  const auto synced = log->sync();
  EXPECT_TRUE(synced) << synced.error().message;
  ASSERT_TRUE(writer->set_meta("case", "ball"));
  EXPECT_TRUE(writer->commit());
  std::filesystem::remove(file);
  const auto gone = log->sync();
  ASSERT_FALSE(gone);
  EXPECT_EQ(gone.error().message, file.string() + ": No such file or directory");
}

TEST(SessionFile, DamageIsReportedNotSkipped) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.session";
  EXPECT_TRUE(create(file).write(1, range(1)));
  run_sql(file, "UPDATE sample SET body = x'00'");
  const auto read = open(file).each<wire::RangeSample>([](const auto &, std::int64_t) { FAIL(); });
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().message, file.string() + ": 1 samples of topic RangeSample have not the size that the file "
                                                  "states: it is damaged");
}

} // namespace
} // namespace bregma::casefile
