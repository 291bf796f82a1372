// The session file: all inputs and outputs of a session in one SQLite database (WAL mode during recording).
//
// Tables: meta(key, value), topic(id, name, size, type), sample(id, topic, time_ns, body), attachment(name, body).
// A body is the bytes of the wire struct. The topic contains its size and the identity of its type (a hash of all its
// members, made by idlc), and meta contains the wire version. A file of another generation, or a topic of another
// layout, is refused with both versions and never misread (docs/wire.md). Samples are in the order of recording;
// time_ns is the host's UTC.
//
// Threads: a SessionWriter or SessionReader belongs to one thread. A file may be read while it is written.
// Errors: Result with a sentence that names the file; nothing throws.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/result.hpp"
#include "idl/topics.hpp"

namespace bregma::casefile {

inline constexpr int kSessionFileVersion = 2; // 1: other numbers of enumerations, no identity of types

// True for wire types that are plain bytes: a pointer is meaningless in a file.
template <class T>
inline constexpr bool kIsRecordable =
    std::is_trivially_copyable_v<T> && !std::is_same_v<T, wire::ImageSlice> &&
    !std::is_same_v<T, wire::SurfacePoints> && !std::is_same_v<T, wire::DeformationField> &&
    !std::is_same_v<T, wire::CorrectedSlice>;

struct Attachment {
  std::string name; // for example "case.toml", "scalp.ply"
  std::string body; // bytes
};

struct MetaEntry {
  std::string key;
  std::string value;
};

struct RecordedTopic {
  std::string name;
  std::size_t size = 0; // bytes of one body
  std::uint64_t count = 0;
};

// Writes in transactions: the first write begins one, and only committed data are in the file. After an error the open
// transaction is rolled back, and the writer can be used again, since a full disk may have been freed.
class SessionWriter {
public:
  // Makes a new file; an existing file is refused.
  [[nodiscard]] static base::Result<SessionWriter> create(const std::filesystem::path &file);
  SessionWriter(SessionWriter &&) noexcept;
  SessionWriter &operator=(SessionWriter &&) noexcept;
  ~SessionWriter(); // commits and closes; the file is then complete, without a -wal file

  [[nodiscard]] base::Result<void> set_meta(std::string_view key, std::string_view value);         // replaces
  [[nodiscard]] base::Result<void> attach(std::string_view name, std::span<const std::byte> body); // replaces
  [[nodiscard]] base::Result<void> write(std::string_view topic, std::int64_t time_ns, std::span<const std::byte> body);
  [[nodiscard]] base::Result<void> commit();
  void rollback() noexcept;

  template <class T> [[nodiscard]] base::Result<void> write(std::int64_t time_ns, const T &sample) {
    static_assert(kIsRecordable<T>);
    return write(wire::Topic<T>::kName, time_ns, std::as_bytes(std::span(&sample, 1)));
  }

private:
  struct Database;
  explicit SessionWriter(std::unique_ptr<Database> database);
  std::unique_ptr<Database> database_;
};

// The log of a file that a SessionWriter has open. Commits go to the log; from time to time it must be copied to the
// file, which waits for the disk. A program whose commits must not wait calls copy() now and then on another thread. It
// must be closed before the writer.
class SessionLog {
public:
  [[nodiscard]] static base::Result<SessionLog> open(const std::filesystem::path &file);
  SessionLog(SessionLog &&) noexcept;
  SessionLog &operator=(SessionLog &&) noexcept;
  ~SessionLog();

  // Brings a new file, its log and their names in the folder to the disk, so that it survives a power failure.
  [[nodiscard]] base::Result<void> sync();
  // Copies what is committed. The writer may commit meanwhile.
  [[nodiscard]] base::Result<void> copy();

private:
  struct Database;
  explicit SessionLog(std::unique_ptr<Database> database);
  std::unique_ptr<Database> database_;
};

class SessionReader {
public:
  // Refuses what is not a session file, and one of an unknown version or of another generation of the wire. A file
  // whose writer was killed is read up to the last commit.
  [[nodiscard]] static base::Result<SessionReader> open(const std::filesystem::path &file);
  // The files of one operation, which a restarted daemon continues in a new one: read as one file, in the order of
  // their beginning, whatever the order here. Meta and attachments are those of the first. Files of several cases are
  // refused.
  [[nodiscard]] static base::Result<SessionReader> open(std::span<const std::filesystem::path> files);
  SessionReader(SessionReader &&) noexcept;
  SessionReader &operator=(SessionReader &&) noexcept;
  ~SessionReader();

  [[nodiscard]] base::Result<std::vector<RecordedTopic>> topics() const;
  [[nodiscard]] base::Result<std::vector<MetaEntry>> meta() const;
  [[nodiscard]] base::Result<std::optional<std::string>> meta(std::string_view key) const; // nullopt: no such key
  [[nodiscard]] base::Result<std::vector<std::string>> attachments() const;                // their names
  [[nodiscard]] base::Result<std::string> attachment(std::string_view name) const;         // an error if there is none

  // Calls visit(const T &, std::int64_t time_ns) for each sample of T's topic in the order of recording. Returns their
  // number; 0 if nothing was recorded on the topic. An error if T has another layout in the file than in this program.
  template <class T, class Visit> [[nodiscard]] base::Result<std::size_t> each(Visit &&visit) const {
    static_assert(kIsRecordable<T>);
    T sample;
    const auto target = std::as_writable_bytes(std::span(&sample, 1));
    return each_body(wire::Topic<T>::kName, target,
                     [&](std::int64_t time_ns) { visit(std::as_const(sample), time_ns); });
  }

private:
  struct Database;
  explicit SessionReader(std::unique_ptr<Database> database);
  // Copies each body into target, then calls visit.
  [[nodiscard]] base::Result<std::size_t> each_body(std::string_view topic, std::span<std::byte> target,
                                                    const std::function<void(std::int64_t)> &visit) const;
  [[nodiscard]] base::Result<std::size_t> each_later(std::string_view topic, std::span<std::byte> target,
                                                     const std::function<void(std::int64_t)> &visit) const;
  std::unique_ptr<Database> database_;
  std::vector<SessionReader> later_; // the files that continue this one
};

} // namespace bregma::casefile
