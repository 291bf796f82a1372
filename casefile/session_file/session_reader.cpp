#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include <sqlite3.h>

#include "casefile/session_file/session_database.hpp"
#include "casefile/session_file/session_file.hpp"
#include "idl/version.hpp"

namespace bregma::casefile {

struct SessionReader::Database {
  detail::Connection connection;

  // Calls visit(statement) for each row.
  template <class Visit> [[nodiscard]] base::Result<void> each_row(detail::Statement &statement, Visit &&visit) const {
    int code = SQLITE_OK;
    while ((code = statement.step()) == SQLITE_ROW) {
      visit(std::as_const(statement));
    }
    return code == SQLITE_DONE ? base::Result<void>() : base::Result<void>(connection.error());
  }
  template <class Row, class Visit>
  [[nodiscard]] base::Result<std::vector<Row>> rows(const char *sql, Visit &&read) const {
    std::vector<Row> out;
    auto statement = connection.prepare(sql);
    if (!statement) {
      return tl::unexpected(statement.error());
    }
    const auto done = each_row(*statement, [&](const detail::Statement &row) { out.push_back(read(row)); });
    return done.map([&] { return std::move(out); });
  }
};

namespace {

// SQLite reads a file that was cut within its last page as if zeros followed. Its header states the size of a page
// (sqlite.org/fileformat2.html, 1.3.2); whole pages that are missing it notices itself.
bool ends_within_a_page(const std::filesystem::path &file) {
  constexpr std::string_view kMark("SQLite format 3\0", 16);
  std::ifstream in(file, std::ios::binary);
  std::array<char, 18> header{};
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  if (error || !in.read(header.data(), header.size()) || std::string_view(header.data(), kMark.size()) != kMark) {
    return false; // SQLite refuses it
  }
  const auto byte = [&header](std::size_t at) { return std::uintmax_t{static_cast<unsigned char>(header[at])}; };
  const std::uintmax_t stated = byte(16) << 8U | byte(17);
  const std::uintmax_t page = stated == 1 ? 65'536 : stated; // 1: does not fit its two bytes
  return page > 0 && size % page != 0;
}

} // namespace

SessionReader::SessionReader(std::unique_ptr<Database> database) : database_(std::move(database)) {}
SessionReader::SessionReader(SessionReader &&) noexcept = default;
SessionReader &SessionReader::operator=(SessionReader &&) noexcept = default;
SessionReader::~SessionReader() = default;

base::Result<SessionReader> SessionReader::open(const std::filesystem::path &file) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored)) {
    return base::failure(file.string() + ": there is no such file");
  }
  if (ends_within_a_page(file)) {
    return base::failure(file.string() + ": is not whole: it ends within a page of its database");
  }
  auto connection = detail::Connection::open(file, detail::OpenMode::kExisting);
  if (!connection) {
    return tl::unexpected(connection.error());
  }
  const auto id = connection->integer("PRAGMA application_id");
  if (!id) {
    return base::failure(id.error().message + "; it cannot be read as a session file");
  }
  if (*id != detail::kApplicationId) {
    return base::failure(file.string() + ": not a session file of Bregma");
  }
  const auto version = connection->integer("PRAGMA user_version");
  if (!version || *version != kSessionFileVersion) {
    return base::failure(file.string() + ": session file of version " + std::to_string(version.value_or(0)) +
                         "; this program reads version " + std::to_string(kSessionFileVersion));
  }
  auto database = std::make_unique<Database>();
  database->connection = std::move(*connection);
  SessionReader reader(std::move(database));
  const auto stated = reader.meta(detail::kWireKey);
  const auto recorded = stated && *stated ? wire::version_from(**stated) : std::nullopt;
  if (!recorded || recorded->generation != wire::kWireVersion.generation) {
    return base::failure(file.string() + ": recorded with wire " +
                         (recorded ? wire::text_of(*recorded) : "(not stated)") + "; this program reads wire " +
                         wire::text_of(wire::kWireVersion) + ": it takes the version of Bregma that recorded it");
  }
  return reader;
}

base::Result<SessionReader> SessionReader::open(std::span<const std::filesystem::path> files) {
  struct Part {
    std::string started;
    SessionReader reader;
  };
  std::vector<Part> parts;
  std::string first_case;
  for (const std::filesystem::path &file : files) {
    auto reader = open(file);
    if (!reader) {
      return tl::unexpected(reader.error());
    }
    const auto name = reader->meta("case");
    const auto started = reader->meta("started");
    if (!name || !started) {
      return tl::unexpected(name ? started.error() : name.error());
    }
    if (parts.empty()) {
      first_case = name->value_or("");
    } else if (name->value_or("") != first_case) {
      return base::failure(file.string() + ": is of case " + name->value_or("(not stated)") + ", " +
                           files.front().string() + " is of case " + first_case +
                           ": only files of one operation are read together");
    }
    parts.push_back({started->value_or(""), std::move(*reader)});
  }
  if (parts.empty()) {
    return base::failure("no session file is given");
  }
  std::stable_sort(parts.begin(), parts.end(), [](const Part &a, const Part &b) { return a.started < b.started; });
  SessionReader out = std::move(parts.front().reader);
  for (auto part = parts.begin() + 1; part != parts.end(); ++part) {
    out.later_.push_back(std::move(part->reader));
  }
  return out;
}

base::Result<std::vector<RecordedTopic>> SessionReader::topics() const {
  auto topics = database_->rows<RecordedTopic>(
      "SELECT name, size, (SELECT count(*) FROM sample WHERE sample.topic = topic.id) FROM topic ORDER BY name",
      [](const detail::Statement &row) {
        return RecordedTopic{row.text(0), static_cast<std::size_t>(row.integer(1)),
                             static_cast<std::uint64_t>(row.integer(2))};
      });
  for (const SessionReader &reader : later_) {
    auto more = topics ? reader.topics() : topics;
    if (!more) {
      return more;
    }
    for (RecordedTopic &topic : *more) {
      const auto known = std::find_if(topics->begin(), topics->end(),
                                      [&](const RecordedTopic &other) { return other.name == topic.name; });
      if (known != topics->end()) {
        known->count += topic.count;
      } else {
        topics->push_back(std::move(topic));
      }
    }
  }
  return topics;
}

base::Result<std::vector<MetaEntry>> SessionReader::meta() const {
  return database_->rows<MetaEntry>("SELECT key, value FROM meta ORDER BY key", [](const detail::Statement &row) {
    return MetaEntry{row.text(0), row.text(1)};
  });
}

base::Result<std::optional<std::string>> SessionReader::meta(std::string_view key) const {
  auto statement = database_->connection.prepare("SELECT value FROM meta WHERE key = ?1");
  if (!statement) {
    return tl::unexpected(statement.error());
  }
  statement->bind(1, key);
  std::optional<std::string> value;
  const auto done = database_->each_row(*statement, [&](const detail::Statement &row) { value = row.text(0); });
  return done.map([&] { return std::move(value); });
}

base::Result<std::vector<std::string>> SessionReader::attachments() const {
  return database_->rows<std::string>("SELECT name FROM attachment ORDER BY name",
                                      [](const detail::Statement &row) { return row.text(0); });
}

base::Result<std::string> SessionReader::attachment(std::string_view name) const {
  auto statement = database_->connection.prepare("SELECT body FROM attachment WHERE name = ?1");
  if (!statement) {
    return tl::unexpected(statement.error());
  }
  statement->bind(1, name);
  std::optional<std::string> body;
  const auto done = database_->each_row(*statement, [&](const detail::Statement &row) { body = row.text(0); });
  if (!done) {
    return tl::unexpected(done.error());
  }
  if (!body) {
    return base::failure(database_->connection.file() + ": has no attachment " + std::string(name));
  }
  return std::move(*body);
}

base::Result<std::size_t> SessionReader::each_body(std::string_view topic, std::span<std::byte> target,
                                                   const std::function<void(std::int64_t)> &visit) const {
  const std::string &file = database_->connection.file();
  auto find = database_->connection.prepare("SELECT id, size, type FROM topic WHERE name = ?1");
  auto select = database_->connection.prepare("SELECT time_ns, body FROM sample WHERE topic = ?1 ORDER BY id");
  if (!find || !select) {
    return tl::unexpected(find ? select.error() : find.error());
  }
  find->bind(1, topic);
  if (const int code = find->step(); code != SQLITE_ROW) {
    return code == SQLITE_DONE ? each_later(topic, target, visit)
                               : base::Result<std::size_t>(database_->connection.error());
  }
  if (const auto size = static_cast<std::size_t>(find->integer(1)); size != target.size()) {
    return base::failure(file + ": topic " + std::string(topic) + " was recorded with " + std::to_string(size) +
                         " bytes per sample, this program's has " + std::to_string(target.size()) +
                         ": it takes the version of Bregma that recorded it");
  }
  if (!std::ranges::equal(find->blob(2), detail::type_identity(topic))) {
    return base::failure(
        file + ": topic " + std::string(topic) +
        " was recorded with another layout of the same size: it takes the version of Bregma that recorded "
        "it");
  }
  select->bind(1, find->integer(0));
  std::size_t number = 0;
  std::size_t damaged = 0;
  const auto done = database_->each_row(*select, [&](const detail::Statement &row) {
    const auto body = row.blob(1);
    if (body.size() != target.size()) {
      ++damaged;
      return;
    }
    std::memcpy(target.data(), body.data(), body.size());
    visit(row.integer(0));
    ++number;
  });
  if (!done) {
    return tl::unexpected(done.error());
  }
  if (damaged > 0) {
    return base::failure(file + ": " + std::to_string(damaged) + " samples of topic " + std::string(topic) +
                         " have not the size that the file states: it is damaged");
  }
  return each_later(topic, target, visit).map([number](std::size_t more) { return number + more; });
}

base::Result<std::size_t> SessionReader::each_later(std::string_view topic, std::span<std::byte> target,
                                                    const std::function<void(std::int64_t)> &visit) const {
  std::size_t number = 0;
  for (const SessionReader &reader : later_) {
    auto read = reader.each_body(topic, target, visit);
    if (!read) {
      return read;
    }
    number += *read;
  }
  return number;
}

} // namespace bregma::casefile
