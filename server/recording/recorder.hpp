// Records all inputs and outputs of a session to its file, outside the loops.
//
//   loops --- Channel (wait-free byte ring, one per producing thread) ---> recorder thread ---> SessionWriter
//
// The recorder drains all rings at an interval in one transaction, so SIGKILL loses at most one interval and the
// current commit. A commit goes to the file's log and does not wait for the disk; another thread copies the log to the
// file. A record leaves its ring only after its commit. If the disk is full, the daemon continues: the
// recorder reports the error and retries, and the rings buffer records. Records that do not fit are dropped and
// counted:
//
//   pushed = recorded + dropped + waiting   (pushes while no file is open or being made are not counted)
//
// Threads: the thread that owns the channel calls push. Any thread that may block calls open, attach, set_poll, close
// and channel. Any thread may call status, which is wait-free.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "base/result.hpp"
#include "casefile/session_file/growth.hpp"
#include "casefile/session_file/session_file.hpp"
#include "idl/topics.hpp"
#include "server/runtime/byte_ring.hpp"
#include "server/runtime/latest_value.hpp"

namespace bregma::recording {

struct RecorderOptions {
  std::size_t channel_bytes = std::size_t{4} << 20; // about 2 s of the records of a 1 kHz loop
  std::chrono::milliseconds interval{20};           // between commits
  std::chrono::milliseconds retry{200};             // between attempts while the disk fails
  std::chrono::milliseconds copy{1000};             // between copies of the log to the file
};

struct RecorderStatus {
  std::uint64_t recorded = 0; // committed to a file, since the start
  std::uint64_t dropped =
      0; // since the start: records that did not fit a ring, or that the disk did not accept before close
  bool open = false;
  bool failing = false;
  char text[256] = {};                 // reason of the failure, for messages
  casefile::RecordingSpace space = {}; // of the open file's disk, measured with every copy of its log
};

namespace detail {
struct Failure {
  bool failing = false;
  char text[256] = {};
};
} // namespace detail

class LogCopier;
class Recorder;

// The producer's end of one thread. Valid as long as its Recorder.
class Channel {
public:
  Channel(std::string name, std::size_t bytes, const std::atomic<bool> &recording);

  // Wait-free, no allocation. Returns false if the record was dropped, which is counted. While no file is open, records
  // are ignored and not counted.
  template <class T> bool push(std::int64_t time_ns, const T &sample) noexcept {
    static_assert(casefile::kIsRecordable<T>);
    return push(wire::Topic<T>::kName, time_ns, std::as_bytes(std::span(&sample, 1)));
  }
  // The same for a sample that is known by its bytes. topic: of static storage.
  bool push(const char *topic, std::int64_t time_ns, std::span<const std::byte> body) noexcept;

  [[nodiscard]] const std::string &name() const noexcept { return name_; }
  [[nodiscard]] std::uint64_t pushed() const noexcept { return ring_.pushed() + ring_.dropped(); }
  [[nodiscard]] std::uint64_t dropped() const noexcept { return ring_.dropped(); }

private:
  friend class Recorder;
  struct Head {
    const char *topic; // static storage
    std::int64_t time_ns;
  };

  runtime::ByteRing ring_;
  std::string name_;
  const std::atomic<bool> &recording_;
};

class Recorder {
public:
  explicit Recorder(RecorderOptions options = {});
  ~Recorder(); // closes
  Recorder(const Recorder &) = delete;
  Recorder &operator=(const Recorder &) = delete;

  // The channel of that name, created on first use. One producer thread per channel; at most kMaxChannels.
  [[nodiscard]] Channel &channel(std::string_view name);

  // Called on the recorder's thread at every interval with a separate channel. It records sources that pipelines must
  // not see, such as the simulator's ground truth. It is also called while no file is open, which empties the source.
  void set_poll(std::function<void(Channel &)> poll);

  // Closes the open file, then begins a new one. Attachments and meta are written first.
  [[nodiscard]] base::Result<void> open(const std::filesystem::path &file,
                                        std::vector<casefile::Attachment> attachments,
                                        std::vector<casefile::MetaEntry> meta);
  // Adds attachments to the open file.
  [[nodiscard]] base::Result<void> attach(casefile::Attachment attachment);
  // Writes all records pushed before. If the disk fails, an error is returned and the records are counted as dropped.
  [[nodiscard]] base::Result<void> close();

  [[nodiscard]] RecorderStatus status() const noexcept;

  static constexpr std::size_t kMaxChannels = 64;

private:
  using Task = std::packaged_task<base::Result<void>()>;

  // Runs the task on the recorder's thread and waits for it.
  base::Result<void> call(std::function<base::Result<void>()> task);
  void run();
  base::Result<void> begin(const std::filesystem::path &file, const std::vector<casefile::Attachment> &attachments,
                           const std::vector<casefile::MetaEntry> &meta);
  base::Result<void> make(const std::filesystem::path &file, const std::vector<casefile::Attachment> &attachments,
                          const std::vector<casefile::MetaEntry> &meta);
  base::Result<void> finish();
  void drain();
  base::Result<std::uint64_t> write_waiting();
  void drop_waiting();
  void report(const base::Result<std::uint64_t> &result);
  [[nodiscard]] std::span<const std::unique_ptr<Channel>> channels() const noexcept;

  RecorderOptions options_;
  std::array<std::unique_ptr<Channel>, kMaxChannels> channels_;
  std::atomic<std::size_t> channel_count_{0};
  std::atomic<bool> recording_{false};
  std::atomic<std::uint64_t> recorded_{0};
  std::atomic<std::uint64_t> undelivered_{0};
  runtime::LatestValue<detail::Failure> failure_;
  runtime::LatestValue<casefile::RecordingSpace> space_; // written by the copier's thread

  std::mutex mutex_; // guards the next three; no loop takes it
  std::condition_variable wake_;
  std::vector<Task> tasks_;
  bool stopping_ = false;

  // Used only by the recorder thread.
  std::optional<casefile::SessionWriter> writer_;
  std::unique_ptr<LogCopier> copier_; // of the writer's file
  std::function<void(Channel &)> poll_;
  bool failing_ = false;
  std::chrono::steady_clock::time_point next_try_;

  std::thread thread_;
};

} // namespace bregma::recording
