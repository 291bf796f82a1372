#include "casefile/session_file/session_database.hpp"

#include <sqlite3.h>

#include "idl/topics.hpp"

namespace bregma::casefile::detail {

std::span<const std::byte> type_identity(std::string_view topic) noexcept {
  const auto bytes_of = [](const dds_topic_descriptor_t &descriptor) {
    return std::as_bytes(std::span(descriptor.type_information.data, descriptor.type_information.sz));
  };
#define BREGMA_IDENTITY(Type, qos)                                                                                     \
  if (topic == wire::Topic<wire::Type>::kName) {                                                                       \
    return bytes_of(wire::Topic<wire::Type>::descriptor());                                                            \
  }
  BREGMA_TOPICS(BREGMA_IDENTITY)
#undef BREGMA_IDENTITY
  return {};
}

Statement &Statement::bind(int index, std::int64_t value) noexcept {
  sqlite3_bind_int64(handle_.get(), index, value);
  return *this;
}

Statement &Statement::bind(int index, std::string_view text) noexcept {
  // An empty view may contain a null pointer, which would bind NULL.
  sqlite3_bind_text(handle_.get(), index, text.empty() ? "" : text.data(), static_cast<int>(text.size()),
                    SQLITE_STATIC);
  return *this;
}

Statement &Statement::bind(int index, std::span<const std::byte> blob) noexcept {
  sqlite3_bind_blob64(handle_.get(), index, blob.empty() ? static_cast<const void *>("") : blob.data(), blob.size(),
                      SQLITE_STATIC);
  return *this;
}

int Statement::step() noexcept { return sqlite3_step(handle_.get()); }

void Statement::reset() noexcept {
  sqlite3_reset(handle_.get());
  sqlite3_clear_bindings(handle_.get());
}

std::int64_t Statement::integer(int column) const noexcept { return sqlite3_column_int64(handle_.get(), column); }

std::string Statement::text(int column) const {
  const auto bytes = blob(column);
  return {reinterpret_cast<const char *>(bytes.data()), bytes.size()};
}

std::span<const std::byte> Statement::blob(int column) const noexcept {
  const auto *data = static_cast<const std::byte *>(sqlite3_column_blob(handle_.get(), column));
  return {data, static_cast<std::size_t>(sqlite3_column_bytes(handle_.get(), column))};
}

void Statement::Finalize::operator()(sqlite3_stmt *handle) const noexcept { sqlite3_finalize(handle); }

void Connection::Close::operator()(sqlite3 *handle) const noexcept { sqlite3_close_v2(handle); }

base::Result<Connection> Connection::open(const std::filesystem::path &file, OpenMode mode) {
  Connection connection;
  connection.file_ = file.string();
  const int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE |
                    (mode == OpenMode::kCreate ? SQLITE_OPEN_CREATE : 0);
  sqlite3 *handle = nullptr;
  const int code = sqlite3_open_v2(connection.file_.c_str(), &handle, flags, nullptr);
  connection.handle_.reset(handle); // SQLite requires a close also after an error
  if (code != SQLITE_OK) {
    return connection.error();
  }
  sqlite3_busy_timeout(handle, 500);
  return connection;
}

base::Result<void> Connection::execute(const char *sql) const {
  if (sqlite3_exec(handle_.get(), sql, nullptr, nullptr, nullptr) != SQLITE_OK) {
    return error();
  }
  return {};
}

base::Result<Statement> Connection::prepare(const char *sql) const {
  sqlite3_stmt *statement = nullptr;
  if (sqlite3_prepare_v3(handle_.get(), sql, -1, SQLITE_PREPARE_PERSISTENT, &statement, nullptr) != SQLITE_OK) {
    return error();
  }
  return Statement(statement);
}

base::Result<void> Connection::run(Statement &statement) const {
  const int code = statement.step();
  base::Result<void> result;
  if (code != SQLITE_DONE) {
    result = error();
  }
  statement.reset();
  return result;
}

base::Result<std::int64_t> Connection::integer(const char *sql) const {
  auto statement = prepare(sql);
  if (!statement) {
    return tl::unexpected(statement.error());
  }
  if (statement->step() != SQLITE_ROW) {
    return error();
  }
  return statement->integer(0);
}

bool Connection::in_transaction() const noexcept { return sqlite3_get_autocommit(handle_.get()) == 0; }

tl::unexpected<base::Error> Connection::error() const {
  const char *text = handle_ ? sqlite3_errmsg(handle_.get()) : "out of memory";
  return base::failure(file_ + ": " + text);
}

} // namespace bregma::casefile::detail
