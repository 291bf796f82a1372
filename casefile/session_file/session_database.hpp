// SQLite for the session file: owners of connections and prepared statements, errors as sentences.
// Private to session_file/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "base/result.hpp"

struct sqlite3;
struct sqlite3_stmt;

namespace bregma::casefile::detail {

inline constexpr int kApplicationId = 0x42524547; // "BREG"

// In meta.
inline constexpr const char *kWireKey = "wire";     // the wire version of the bodies
inline constexpr const char *kLayoutKey = "layout"; // the version of the tables, as in user_version

// Identifies the layout of a topic's type. Empty for an unknown topic name.
[[nodiscard]] std::span<const std::byte> type_identity(std::string_view topic) noexcept;

// A prepared statement. Bound values must live until the next step or reset.
class Statement {
public:
  Statement() = default;
  explicit Statement(sqlite3_stmt *handle) : handle_(handle) {}

  Statement &bind(int index, std::int64_t value) noexcept;
  Statement &bind(int index, std::string_view text) noexcept;
  Statement &bind(int index, std::span<const std::byte> blob) noexcept;
  // SQLITE_ROW, SQLITE_DONE or an error code.
  [[nodiscard]] int step() noexcept;
  void reset() noexcept;

  [[nodiscard]] std::int64_t integer(int column) const noexcept;
  [[nodiscard]] std::string text(int column) const;
  [[nodiscard]] std::span<const std::byte> blob(int column) const noexcept; // until the next step

private:
  struct Finalize {
    void operator()(sqlite3_stmt *handle) const noexcept;
  };
  std::unique_ptr<sqlite3_stmt, Finalize> handle_;
};

enum class OpenMode { kCreate, kExisting };

class Connection {
public:
  [[nodiscard]] static base::Result<Connection> open(const std::filesystem::path &file, OpenMode mode);

  [[nodiscard]] base::Result<void> execute(const char *sql) const;
  [[nodiscard]] base::Result<Statement> prepare(const char *sql) const;
  // Runs a statement without rows, and resets it.
  [[nodiscard]] base::Result<void> run(Statement &statement) const;
  [[nodiscard]] base::Result<std::int64_t> integer(const char *sql) const; // the first column of the first row
  [[nodiscard]] bool in_transaction() const noexcept;
  // SQLite's last error as "file: message".
  [[nodiscard]] tl::unexpected<base::Error> error() const;
  [[nodiscard]] const std::string &file() const noexcept { return file_; }

private:
  struct Close {
    void operator()(sqlite3 *handle) const noexcept;
  };
  std::unique_ptr<sqlite3, Close> handle_;
  std::string file_;
};

} // namespace bregma::casefile::detail
