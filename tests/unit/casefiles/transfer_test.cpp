// A case server and a fetcher over DDS, both in this process.
#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "base/read_file.hpp"
#include "clients/casefiles/case_fetcher.hpp"
#include "clients/casefiles/case_sender.hpp"
#include "idl/boot_clock.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::casefiles {
namespace {

using namespace std::chrono_literals;
using State = CaseStatus::State;

std::uint32_t own_domain() { return 100 + static_cast<std::uint32_t>(getpid()) % 100; }

Bundle bundle(const std::string &id, const std::string &content) {
  Bundle out;
  out.case_id = id;
  const auto bytes = std::as_bytes(std::span(content));
  const Hash hash = sha256(bytes);
  out.files[hash].assign(bytes.begin(), bytes.end());
  out.manifest = nlohmann::json{{"id", id},
                                {"image", {{"sha256", to_hex(hash)}, {"bytes", content.size()}}},
                                {"meshes", nlohmann::json::array()}}
                     .dump();
  return out;
}

// Serves on a thread of its own; commands run there.
class Server {
public:
  Server() : participant_(own_domain()), sender_(participant_, "host"), thread_([this] { run(); }) {}
  ~Server() {
    stopping_ = true;
    thread_.join();
  }
  void offer(const Bundle &bundle) {
    const std::lock_guard lock(mutex_);
    command_ = [this, bundle] { sender_.offer(bundle); };
  }
  void offer_none() {
    const std::lock_guard lock(mutex_);
    command_ = [this] { sender_.offer_none(); };
  }
  [[nodiscard]] std::uint64_t sent() const { return sent_; }

private:
  void run() {
    while (!stopping_) {
      std::function<void()> command;
      {
        const std::lock_guard lock(mutex_);
        command.swap(command_);
      }
      if (command) {
        command();
      }
      sender_.serve(5ms);
      sent_ = sender_.sent_chunks();
    }
  }

  dds::Participant participant_;
  CaseSender sender_;
  std::mutex mutex_;
  std::function<void()> command_;
  std::atomic<std::uint64_t> sent_{0};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

class Transfer : public ::testing::Test {
protected:
  Transfer() { follow(fetcher_); }
  static void follow(CaseFetcher &fetcher) {
    wire::BootId boot_id;
    const auto own = wire::boot_id();
    std::copy(own.begin(), own.end(), std::begin(boot_id));
    fetcher.follow(boot_id);
  }
  static bool reaches(const CaseFetcher &fetcher, State state) {
    for (int i = 0; i < 2000; ++i) {
      if (fetcher.status().state == state) {
        return true;
      }
      std::this_thread::sleep_for(10ms);
    }
    return false;
  }

  test::TemporaryFolder folder_;
  dds::Participant participant_{own_domain()};
  CaseFetcher fetcher_{participant_, *CaseFetcher::make_folder(folder_ / "cases")};
};

TEST_F(Transfer, ACaseArrivesIsKeptAndChanges) {
  EXPECT_TRUE(reaches(fetcher_, State::kNoServer));
  Server server;
  EXPECT_TRUE(reaches(fetcher_, State::kNone));
  const std::string content(3'000'000, 'x');
  server.offer(bundle("c1", content));
  ASSERT_TRUE(reaches(fetcher_, State::kComplete)) << fetcher_.status().text;
  const CaseStatus first = fetcher_.status();
  EXPECT_EQ(first.id, "c1");
  EXPECT_EQ(nlohmann::json::parse(*fetcher_.json())["hash"], first.hash);
  EXPECT_EQ(*base::read_file(*fetcher_.file(first.hash, "image")), content);
  EXPECT_FALSE(fetcher_.file(first.hash, "labels"));
  EXPECT_FALSE(fetcher_.file("other", "image"));

  server.offer(bundle("c2", "small"));
  for (int i = 0; i < 1000 && fetcher_.status().id != "c2"; ++i) {
    std::this_thread::sleep_for(10ms);
  }
  ASSERT_TRUE(reaches(fetcher_, State::kComplete));
  EXPECT_EQ(*base::read_file(*fetcher_.file(fetcher_.status().hash, "image")), "small");
  EXPECT_TRUE(fetcher_.file(first.hash, "image")) << "a page may still be loading it";
  std::this_thread::sleep_for(100ms); // the server states what it sent after serve()
  const std::uint64_t sent = server.sent();
  server.offer(bundle("c1", content));
  for (int i = 0; i < 1000 && fetcher_.status().hash != first.hash; ++i) {
    std::this_thread::sleep_for(10ms);
  }
  EXPECT_EQ(fetcher_.status().hash, first.hash);
  EXPECT_EQ(server.sent(), sent) << "what is on the disk is not sent again";

  server.offer_none();
  EXPECT_TRUE(reaches(fetcher_, State::kNone));
  EXPECT_FALSE(fetcher_.json());
}

TEST_F(Transfer, AFileThatWasChangedOnTheDiskIsFetchedAgain) {
  Server server;
  server.offer(bundle("c1", "content"));
  ASSERT_TRUE(reaches(fetcher_, State::kComplete));
  const auto file = *fetcher_.file(fetcher_.status().hash, "image");
  folder_.write(file.lexically_relative(folder_.path()), "CONTENT");
  CaseFetcher other(participant_, folder_ / "cases");
  follow(other);
  ASSERT_TRUE(reaches(other, State::kComplete));
  EXPECT_EQ(*base::read_file(file), "content");
}

TEST_F(Transfer, TheCaseOfAnotherHostIsNotUsed) {
  wire::BootId other{1};
  fetcher_.follow(other);
  Server server;
  server.offer(bundle("c1", "content"));
  std::this_thread::sleep_for(500ms);
  EXPECT_EQ(fetcher_.status().state, State::kNoServer);
}

TEST(CaseSender, WhatIsAskedForBeyondItsQueueIsCounted) {
  dds::Participant participant(own_domain());
  CaseSender sender(participant, "host");
  const Bundle large = bundle("c1", std::string(1280 * std::size_t{bregma_wire_CASE_CHUNK_BYTES}, 'x'));
  sender.offer(large);
  dds::Writer<wire::CaseRequest> requests(participant);
  for (int i = 0; i < 200 && requests.matched_readers() == 0; ++i) {
    std::this_thread::sleep_for(10ms);
  }
  wire::CaseRequest request{};
  std::copy(large.files.begin()->first.begin(), large.files.begin()->first.end(), std::begin(request.file));
  request.count = 64;
  for (; request.first_chunk < 1280; request.first_chunk += request.count) {
    ASSERT_TRUE(requests.write(request));
  }
  for (int i = 0; i < 200 && sender.dropped_chunks() == 0; ++i) {
    sender.serve(10ms);
  }
  EXPECT_GT(sender.dropped_chunks(), 0U);
  EXPECT_LE(sender.dropped_chunks(), 1280U - 1024U);
}

TEST_F(Transfer, TheFolderIsForItsOwnerOnly) {
  using std::filesystem::perms;
  EXPECT_EQ(std::filesystem::status(folder_ / "cases").permissions(), perms::owner_all);
}

} // namespace
} // namespace bregma::casefiles
