#include "server/recording/recorder.hpp"

#include <cstring>
#include <stdexcept>
#include <stop_token>
#include <system_error>
#include <utility>

#include "idl/names.hpp"
#include "server/recording/recording_space.hpp"
#include "server/runtime/realtime.hpp"

namespace bregma::recording {
namespace {

using base::Result;

// Maximal number of records per channel and transaction, so that a full channel does not delay the commit.
constexpr int kBatch = 4096;

constexpr const char *kPollChannel = "poll";

} // namespace

// Copies the log of a session file to the file on a thread of its own, for as long as it exists, and measures the space
// on its disk.
class LogCopier {
public:
  LogCopier(std::filesystem::path file, casefile::SessionLog log, std::chrono::milliseconds interval,
            runtime::LatestValue<casefile::RecordingSpace> &space)
      : file_(std::move(file)), log_(std::move(log)), space_(space),
        thread_([this, interval](const std::stop_token &stop) { run(stop, interval); }) {}

private:
  void run(const std::stop_token &stop, std::chrono::milliseconds interval) {
    static_cast<void>(runtime::set_up_thread({.name = "recorder_copy"}));
    std::mutex mutex;
    std::condition_variable_any wake;
    std::unique_lock lock(mutex);
    static_cast<void>(log_.sync()); // a disk that fails is noticed by the recorder's commits
    measure();
    while (!wake.wait_for(lock, stop, interval, [&stop] { return stop.stop_requested(); })) {
      static_cast<void>(log_.copy());
      measure();
    }
    space_.store({});
  }

  void measure() {
    const std::chrono::duration<double> time = std::chrono::steady_clock::now().time_since_epoch();
    growth_.observe(recording_bytes(file_), time.count());
    std::error_code error;
    const auto space = std::filesystem::space(file_, error);
    space_.store(error ? casefile::RecordingSpace{} : casefile::RecordingSpace{space.available, growth_.bytes_per_s()});
  }

  std::filesystem::path file_;
  casefile::SessionLog log_;
  RecordingGrowth growth_;
  runtime::LatestValue<casefile::RecordingSpace> &space_;
  std::jthread thread_; // last: it uses the log
};

Channel::Channel(std::string name, std::size_t bytes, const std::atomic<bool> &recording)
    : ring_(bytes), name_(std::move(name)), recording_(recording) {}

bool Channel::push(const char *topic, std::int64_t time_ns, std::span<const std::byte> body) noexcept {
  if (!recording_.load(std::memory_order_relaxed)) {
    return true;
  }
  const Head head{topic, time_ns};
  return ring_.try_push(std::as_bytes(std::span(&head, 1)), body);
}

Recorder::Recorder(RecorderOptions options) : options_(options) {
  static_cast<void>(channel(kPollChannel));
  thread_ = std::thread([this] { run(); });
}

Recorder::~Recorder() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

Channel &Recorder::channel(std::string_view name) {
  const std::lock_guard lock(mutex_);
  for (const auto &known : channels()) {
    if (known->name() == name) {
      return *known;
    }
  }
  const std::size_t count = channel_count_.load(std::memory_order_relaxed);
  if (count == kMaxChannels) {
    throw std::length_error("more than " + std::to_string(kMaxChannels) + " recording channels");
  }
  channels_[count] = std::make_unique<Channel>(std::string(name), options_.channel_bytes, recording_);
  channel_count_.store(count + 1, std::memory_order_release);
  return *channels_[count];
}

std::span<const std::unique_ptr<Channel>> Recorder::channels() const noexcept {
  return std::span(channels_).first(channel_count_.load(std::memory_order_acquire));
}

void Recorder::set_poll(std::function<void(Channel &)> poll) {
  static_cast<void>(call([this, &poll]() -> Result<void> {
    poll_ = std::move(poll);
    return {};
  }));
}

Result<void> Recorder::open(const std::filesystem::path &file, std::vector<casefile::Attachment> attachments,
                            std::vector<casefile::MetaEntry> meta) {
  return call([&] { return begin(file, attachments, meta); });
}

Result<void> Recorder::attach(casefile::Attachment attachment) {
  return call([&]() -> Result<void> {
    if (!writer_) {
      return base::failure("attachment " + attachment.name + ": no session file is open");
    }
    auto attached = writer_->attach(attachment.name, std::as_bytes(std::span(attachment.body))).and_then([&] {
      return writer_->commit();
    });
    if (!attached) {
      writer_->rollback();
    }
    return attached;
  });
}

Result<void> Recorder::close() {
  return call([this] { return finish(); });
}

RecorderStatus Recorder::status() const noexcept {
  RecorderStatus out;
  out.recorded = recorded_.load(std::memory_order_relaxed);
  out.dropped = undelivered_.load(std::memory_order_relaxed);
  for (const auto &channel : channels()) {
    out.dropped += channel->dropped();
  }
  out.open = recording_.load(std::memory_order_relaxed);
  out.space = space_.load().value_or(casefile::RecordingSpace{});
  if (const auto failure = failure_.load()) {
    out.failing = failure->failing;
    std::memcpy(out.text, failure->text, sizeof out.text);
  }
  return out;
}

Result<void> Recorder::call(std::function<Result<void>()> task) {
  Task packaged(std::move(task));
  auto result = packaged.get_future();
  {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(packaged));
  }
  wake_.notify_one();
  return result.get();
}

void Recorder::run() {
  // Programs that keep all cores busy must not delay a commit, or a killed daemon would lose more than an interval.
  // Without the right to it the recorder runs as any other thread.
  static_cast<void>(runtime::set_up_thread({.name = "recorder", .nice = -10}));
  bool stopping = false;
  while (!stopping) {
    std::vector<Task> tasks;
    {
      std::unique_lock lock(mutex_);
      wake_.wait_for(lock, options_.interval, [this] { return stopping_ || !tasks_.empty(); });
      tasks.swap(tasks_);
      stopping = stopping_;
    }
    if (poll_) {
      poll_(*channels_[0]);
    }
    drain();
    for (Task &task : tasks) {
      task();
    }
  }
  static_cast<void>(finish());
}

Result<void> Recorder::begin(const std::filesystem::path &file, const std::vector<casefile::Attachment> &attachments,
                             const std::vector<casefile::MetaEntry> &meta) {
  static_cast<void>(finish()); // records that the disk did not accept are counted; another folder may have space
  recording_.store(true, std::memory_order_relaxed); // records wait in the rings while the file is made
  auto made = make(file, attachments, meta);
  if (!made) {
    recording_.store(false, std::memory_order_relaxed);
    drop_waiting();
  }
  return made;
}

Result<void> Recorder::make(const std::filesystem::path &file, const std::vector<casefile::Attachment> &attachments,
                            const std::vector<casefile::MetaEntry> &meta) {
  auto writer = casefile::SessionWriter::create(file);
  if (!writer) {
    return tl::unexpected(writer.error());
  }
  Result<void> written;
  for (const casefile::Attachment &attachment : attachments) {
    written =
        written.and_then([&] { return writer->attach(attachment.name, std::as_bytes(std::span(attachment.body))); });
  }
  for (const casefile::MetaEntry &entry : meta) {
    written = written.and_then([&] { return writer->set_meta(entry.key, entry.value); });
  }
  written = written.and_then([&] { return writer->commit(); });
  if (written) {
    writer_.emplace(std::move(*writer));
    if (auto log = casefile::SessionLog::open(file)) { // else the writer's commits copy the log
      copier_ = std::make_unique<LogCopier>(file, std::move(*log), options_.copy, space_);
    }
  }
  return written;
}

Result<void> Recorder::finish() {
  if (!writer_) {
    return {};
  }
  recording_.store(false, std::memory_order_relaxed);
  next_try_ = {}; // one last attempt, regardless of earlier errors
  drain();
  const RecorderStatus last = status();
  Result<void> result;
  if (last.failing) {
    result = base::failure(last.text);
  } else {
    result = writer_->set_meta("recorded", std::to_string(last.recorded)).and_then([&] {
      return writer_->set_meta("dropped", std::to_string(last.dropped));
    });
  }
  copier_.reset(); // before the writer
  writer_.reset();
  drop_waiting();
  report(std::uint64_t{0}); // the file that failed is closed
  return result;
}

void Recorder::drain() {
  if (!writer_) {
    drop_waiting();
    return;
  }
  if (failing_ && std::chrono::steady_clock::now() < next_try_) {
    return;
  }
  for (bool more = true; more;) {
    const auto written = write_waiting();
    report(written);
    more = written && *written >= kBatch;
  }
}

// One transaction. Records leave the rings only when it is committed.
Result<std::uint64_t> Recorder::write_waiting() {
  std::uint64_t number = 0;
  Result<void> written;
  for (const auto &channel : channels()) {
    for (int i = 0; i < kBatch && written; ++i) {
      const auto record = channel->ring_.next();
      if (!record) {
        break;
      }
      Channel::Head head{};
      std::memcpy(&head, record->data(), sizeof head);
      written = writer_->write(head.topic, head.time_ns, record->subspan(sizeof head));
      ++number;
    }
  }
  written = written.and_then([this] { return writer_->commit(); });
  if (!written) {
    writer_->rollback();
  }
  for (const auto &channel : channels()) {
    if (written) {
      channel->ring_.release();
    } else {
      channel->ring_.rewind();
    }
  }
  return written.map([&] { return number; });
}

// These records will not be written: no file is open, or the disk did not accept them.
void Recorder::drop_waiting() {
  for (const auto &channel : channels()) {
    std::uint64_t number = 0;
    while (channel->ring_.next()) {
      ++number;
    }
    channel->ring_.release();
    undelivered_.fetch_add(number, std::memory_order_relaxed);
  }
}

void Recorder::report(const Result<std::uint64_t> &result) {
  if (result) {
    recorded_.fetch_add(*result, std::memory_order_relaxed);
  } else {
    next_try_ = std::chrono::steady_clock::now() + options_.retry;
  }
  if (result.has_value() != failing_) {
    return; // nothing changed
  }
  failing_ = !result;
  detail::Failure failure{};
  failure.failing = failing_;
  if (!result) {
    wire::set_text(failure.text, result.error().message);
  }
  failure_.store(failure);
}

} // namespace bregma::recording
