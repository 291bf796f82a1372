#include <cerrno>
#include <map>
#include <string>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <sqlite3.h>
#include <unistd.h>

#include "casefile/session_file/session_database.hpp"
#include "casefile/session_file/session_file.hpp"
#include "idl/version.hpp"

namespace bregma::casefile {
namespace {

// NORMAL in WAL mode: a commit writes to the log, which survives a crash of the process. The log is synced when it is
// copied to the database, so a power failure can lose the last commits but not the file. A commit copies the log itself
// only if it has grown to 64 MB, because nothing else has (SessionLog).
constexpr const char *kPragmas = "PRAGMA journal_mode=WAL; PRAGMA temp_store=MEMORY; PRAGMA wal_autocheckpoint=16384;";

// The new file is made without waiting for the disk: on a busy one each sync can take a second, for which nothing would
// be recorded. SessionLog::sync() brings it to the disk.
constexpr const char *kWithoutSync = "PRAGMA synchronous=OFF;";
constexpr const char *kWithSync = "PRAGMA synchronous=NORMAL;";

constexpr const char *kSchema =
    "CREATE TABLE meta(key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;"
    "CREATE TABLE topic(id INTEGER PRIMARY KEY, name TEXT UNIQUE NOT NULL, size INTEGER NOT "
    "NULL, type BLOB NOT NULL);"
    "CREATE TABLE sample(id INTEGER PRIMARY KEY, topic INTEGER NOT NULL, time_ns INTEGER "
    "NOT NULL, body BLOB NOT NULL);"
    "CREATE INDEX sample_by_topic ON sample(topic);"
    "CREATE TABLE attachment(name TEXT PRIMARY KEY, body BLOB NOT NULL);";

struct TopicEntry {
  std::int64_t id = 0;
  std::size_t size = 0;
};

} // namespace

struct SessionWriter::Database {
  detail::Connection connection;
  // Statements are finalized before the connection closes: members are destroyed in reverse order.
  detail::Statement insert_topic;
  detail::Statement find_topic;
  detail::Statement insert_sample;
  detail::Statement set_meta;
  detail::Statement attach;
  std::map<std::string, TopicEntry, std::less<>> topics; // topics in the table, from this or an earlier transaction

  [[nodiscard]] base::Result<void> prepare();
  [[nodiscard]] base::Result<void> begin() const {
    return connection.in_transaction() ? base::Result<void>() : connection.execute("BEGIN IMMEDIATE");
  }
  [[nodiscard]] base::Result<TopicEntry> topic(std::string_view name, std::size_t size);
};

base::Result<void> SessionWriter::Database::prepare() {
  const std::pair<detail::Statement *, const char *> statements[] = {
      {&insert_topic, "INSERT OR IGNORE INTO topic(name, size, type) VALUES(?1, ?2, ?3)"},
      {&find_topic, "SELECT id, size FROM topic WHERE name = ?1"},
      {&insert_sample, "INSERT INTO sample(topic, time_ns, body) VALUES(?1, ?2, ?3)"},
      {&set_meta, "INSERT OR REPLACE INTO meta(key, value) VALUES(?1, ?2)"},
      {&attach, "INSERT OR REPLACE INTO attachment(name, body) VALUES(?1, ?2)"}};
  for (const auto &[statement, sql] : statements) {
    auto prepared = connection.prepare(sql);
    if (!prepared) {
      return tl::unexpected(prepared.error());
    }
    *statement = std::move(*prepared);
  }
  return {};
}

base::Result<TopicEntry> SessionWriter::Database::topic(std::string_view name, std::size_t size) {
  if (const auto known = topics.find(name); known != topics.end()) {
    return known->second;
  }
  insert_topic.bind(1, name).bind(2, static_cast<std::int64_t>(size)).bind(3, detail::type_identity(name));
  if (auto inserted = connection.run(insert_topic); !inserted) {
    return tl::unexpected(inserted.error());
  }
  find_topic.bind(1, name);
  if (find_topic.step() != SQLITE_ROW) {
    find_topic.reset();
    return connection.error();
  }
  const TopicEntry entry{find_topic.integer(0), static_cast<std::size_t>(find_topic.integer(1))};
  find_topic.reset();
  return topics.emplace(std::string(name), entry).first->second;
}

SessionWriter::SessionWriter(std::unique_ptr<Database> database) : database_(std::move(database)) {}
SessionWriter::SessionWriter(SessionWriter &&) noexcept = default;
SessionWriter &SessionWriter::operator=(SessionWriter &&) noexcept = default;

SessionWriter::~SessionWriter() {
  if (!database_) {
    return;
  }
  if (!commit()) {
    rollback();
  }
  // Without its log, the file can be copied and read from a read-only medium. If a reader is active, the log remains
  // until it ends.
  static_cast<void>(database_->connection.execute("PRAGMA journal_mode=DELETE"));
}

base::Result<SessionWriter> SessionWriter::create(const std::filesystem::path &file) {
  std::error_code ignored;
  if (std::filesystem::exists(file, ignored)) {
    return base::failure(file.string() + ": exists already; a session file is never written over");
  }
  const auto folder = file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
  if (!std::filesystem::is_directory(folder, ignored)) {
    return base::failure(file.string() + ": there is no folder " + folder.string());
  }
  auto connection = detail::Connection::open(file, detail::OpenMode::kCreate);
  if (!connection) {
    return tl::unexpected(connection.error());
  }
  auto database = std::make_unique<Database>();
  database->connection = std::move(*connection);
  const std::string identity = "PRAGMA application_id=" + std::to_string(detail::kApplicationId) +
                               "; PRAGMA user_version=" + std::to_string(kSessionFileVersion) + ";";
  const std::string schema = "BEGIN IMMEDIATE;" + identity + kSchema + "COMMIT;";
  const auto made = database->connection.execute(kWithoutSync)
                        .and_then([&] { return database->connection.execute(kPragmas); })
                        .and_then([&] { return database->connection.execute(schema.c_str()); })
                        .and_then([&] { return database->connection.execute(kWithSync); })
                        .and_then([&] { return database->prepare(); });
  if (!made) {
    return tl::unexpected(made.error());
  }
  SessionWriter writer(std::move(database));
  const auto stated =
      writer.set_meta(detail::kWireKey, wire::text_of(wire::kWireVersion))
          .and_then([&] { return writer.set_meta(detail::kLayoutKey, std::to_string(kSessionFileVersion)); })
          .and_then([&] { return writer.commit(); });
  return stated.map([&] { return std::move(writer); });
}

base::Result<void> SessionWriter::set_meta(std::string_view key, std::string_view value) {
  return database_->begin().and_then([&] {
    database_->set_meta.bind(1, key).bind(2, value);
    return database_->connection.run(database_->set_meta);
  });
}

base::Result<void> SessionWriter::attach(std::string_view name, std::span<const std::byte> body) {
  return database_->begin().and_then([&] {
    database_->attach.bind(1, name).bind(2, body);
    return database_->connection.run(database_->attach);
  });
}

base::Result<void> SessionWriter::write(std::string_view topic, std::int64_t time_ns, std::span<const std::byte> body) {
  if (auto begun = database_->begin(); !begun) {
    return begun;
  }
  const auto entry = database_->topic(topic, body.size());
  if (!entry) {
    return tl::unexpected(entry.error());
  }
  if (entry->size != body.size()) {
    return base::failure(database_->connection.file() + ": topic " + std::string(topic) + " holds bodies of " +
                         std::to_string(entry->size) + " bytes, not " + std::to_string(body.size()));
  }
  database_->insert_sample.bind(1, entry->id).bind(2, time_ns).bind(3, body);
  return database_->connection.run(database_->insert_sample);
}

base::Result<void> SessionWriter::commit() {
  return database_->connection.in_transaction() ? database_->connection.execute("COMMIT") : base::Result<void>();
}

void SessionWriter::rollback() noexcept {
  // After a full disk SQLite may have rolled back by itself. In both cases the topics of the transaction are lost.
  if (database_->connection.in_transaction()) {
    static_cast<void>(database_->connection.execute("ROLLBACK"));
  }
  database_->topics.clear();
}

struct SessionLog::Database {
  detail::Connection connection;
};

SessionLog::SessionLog(std::unique_ptr<Database> database) : database_(std::move(database)) {}
SessionLog::SessionLog(SessionLog &&) noexcept = default;
SessionLog &SessionLog::operator=(SessionLog &&) noexcept = default;
SessionLog::~SessionLog() = default;

base::Result<SessionLog> SessionLog::open(const std::filesystem::path &file) {
  auto connection = detail::Connection::open(file, detail::OpenMode::kExisting);
  return connection.map([](detail::Connection &opened) {
    auto database = std::make_unique<Database>();
    database->connection = std::move(opened);
    return SessionLog(std::move(database));
  });
}

base::Result<void> SessionLog::sync() {
  const std::filesystem::path file = database_->connection.file();
  const auto folder = file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
  for (const std::filesystem::path &part : {file, std::filesystem::path(file.string() + "-wal"), folder}) {
    const int handle = ::open(part.c_str(), O_RDONLY | O_CLOEXEC);
    const int error = handle < 0 || ::fsync(handle) != 0 ? errno : 0;
    if (handle >= 0) {
      ::close(handle);
    }
    if (error != 0) {
      return base::failure(part.string() + ": " + std::generic_category().message(error));
    }
  }
  return {};
}

base::Result<void> SessionLog::copy() {
  return database_->connection.execute("PRAGMA synchronous=NORMAL; PRAGMA wal_checkpoint(PASSIVE)");
}

} // namespace bregma::casefile
