// Latest value and rings: the reader thread gets the written values complete and in order. The thread sanitizer build
// of these tests shows that there is no data race.
#include <array>
#include <atomic>
#include <cstring>
#include <random>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "server/runtime/byte_ring.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/runtime/spsc_ring.hpp"
#include "tests/support/allocation_counter.hpp"

namespace bregma::runtime {
namespace {

// Its size is not a multiple of a word.
struct Wide {
  std::array<std::uint32_t, 101> numbers;
};

Wide wide(std::uint32_t number) {
  Wide out{};
  out.numbers.fill(number);
  return out;
}

TEST(LatestValue, IsEmptyAtFirstAndThenHoldsTheLastValue) {
  LatestValue<Wide> latest;
  EXPECT_FALSE(latest.load().has_value());
  Wide value{};
  std::uint64_t seen = 0;
  EXPECT_FALSE(latest.load_newer(value, seen));
  for (std::uint32_t i = 1; i <= 9; ++i) {
    latest.store(wide(i));
  }
  EXPECT_TRUE(latest.load_newer(value, seen));
  EXPECT_EQ(value.numbers, wide(9).numbers);
  EXPECT_EQ(seen, 9U);
  EXPECT_FALSE(latest.load_newer(value, seen));
  EXPECT_EQ(latest.load()->numbers, wide(9).numbers);
}

TEST(LatestValue, SeveralReadersSeeCompleteValuesInIncreasingOrder) {
  constexpr std::uint32_t kLast = 20'000;
  LatestValue<Wide> latest;
  std::atomic<int> torn{0};
  std::atomic<int> backwards{0};
  const auto read = [&] {
    std::uint64_t seen = 0;
    std::uint32_t previous = 0;
    Wide value{};
    while (previous < kLast) {
      if (latest.load_newer(value, seen)) {
        torn += value.numbers != wide(value.numbers[0]).numbers ? 1 : 0;
        backwards += value.numbers[0] <= previous || value.numbers[0] != seen ? 1 : 0;
        previous = value.numbers[0];
      }
    }
  };
  std::thread first(read);
  std::thread second(read);
  for (std::uint32_t i = 1; i <= kLast; ++i) {
    latest.store(wide(i));
  }
  first.join();
  second.join();
  EXPECT_EQ(torn, 0);
  EXPECT_EQ(backwards, 0);
}

TEST(SpscRing, DropsAndCountsValuesThatDoNotFit) {
  SpscRing<int, 4> ring;
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(ring.try_push(i), i < 4);
  }
  EXPECT_EQ(ring.dropped(), 2U);
  EXPECT_EQ(ring.size(), 4U);
  int value = -1;
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(ring.try_pop(value));
    EXPECT_EQ(value, i);
  }
  EXPECT_FALSE(ring.try_pop(value));
}

TEST(SpscRing, BetweenThreadsEveryValueArrivesInOrderOrIsCountedAsDropped) {
  constexpr int kLast = 200'000;
  SpscRing<int, 64> ring;
  std::atomic<bool> done{false};
  int received = 0;
  int previous = 0;
  bool in_order = true;
  std::thread reader([&] {
    int value = 0;
    for (;;) {
      const bool last_look = done.load();
      if (ring.try_pop(value)) {
        ++received;
        in_order = in_order && value > previous;
        previous = value;
      } else if (last_look) {
        return;
      }
    }
  });
  for (int i = 1; i <= kLast; ++i) {
    ring.try_push(i);
  }
  done = true;
  reader.join();
  EXPECT_TRUE(in_order);
  EXPECT_EQ(static_cast<std::uint64_t>(received) + ring.dropped(), static_cast<std::uint64_t>(kLast));
}

// A record contains its number and length in its head, and its number in every byte of its body.
struct Head {
  std::uint64_t number;
  std::uint64_t length;
};

bool push(ByteRing &ring, std::uint64_t number, std::size_t length) {
  const Head head{number, length};
  std::array<std::byte, 700> body{};
  body.fill(static_cast<std::byte>(number));
  return ring.try_push(std::as_bytes(std::span(&head, 1)), std::span(body).first(length));
}

// The number of the next record; 0 if there is none. Corruption is an error.
std::uint64_t next(ByteRing &ring) {
  const auto record = ring.next();
  if (!record) {
    return 0;
  }
  Head head{};
  std::memcpy(&head, record->data(), sizeof head);
  EXPECT_EQ(record->size(), sizeof head + head.length);
  for (const std::byte byte : record->subspan(sizeof head)) {
    EXPECT_EQ(byte, static_cast<std::byte>(head.number));
  }
  return head.number;
}

TEST(ByteRing, KeepsRecordsUntilTheyAreReleased) {
  ByteRing ring(4096);
  EXPECT_TRUE(push(ring, 1, 100));
  EXPECT_TRUE(push(ring, 2, 0));
  EXPECT_EQ(next(ring), 1U);
  EXPECT_EQ(next(ring), 2U);
  EXPECT_EQ(next(ring), 0U);
  ring.rewind();
  EXPECT_EQ(next(ring), 1U);
  ring.release();
  EXPECT_EQ(next(ring), 2U);
  ring.rewind();
  EXPECT_EQ(next(ring), 2U);
  ring.release();
  ring.rewind();
  EXPECT_EQ(next(ring), 0U);
}

TEST(ByteRing, RandomLengthsWrapAroundWithoutCorruption) {
  constexpr unsigned kSeed = 11;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_int_distribution<std::size_t> length(0, 700);
  ByteRing ring(4096);
  std::uint64_t pushed = 0;
  std::uint64_t read = 0;
  for (int round = 0; round < 5'000; ++round) {
    for (int i = 0; i < 3; ++i) {
      pushed += push(ring, pushed + 1, length(random)) ? 1 : 0;
    }
    if (round % 7 == 0) {
      while (next(ring) != 0) {
      }
      ring.rewind();
    }
    for (int i = 0; i < 2; ++i) {
      if (const auto number = next(ring); number != 0) {
        ASSERT_EQ(number, ++read);
      }
    }
    ring.release();
  }
  EXPECT_EQ(ring.pushed(), pushed);
  EXPECT_EQ(ring.pushed() + ring.dropped(), 15'000U);
  EXPECT_GT(ring.dropped(), 0U);
  EXPECT_GT(read, 9'000U);
}

TEST(ByteRing, ARecordThatCanNeverFitIsDropped) {
  ByteRing ring(4096);
  const std::vector<std::byte> large(5000);
  EXPECT_FALSE(ring.try_push({}, large));
  EXPECT_EQ(ring.dropped(), 1U);
  EXPECT_TRUE(push(ring, 1, 10));
  EXPECT_EQ(next(ring), 1U);
}

TEST(ByteRing, BetweenThreadsEveryRecordArrivesInOrderOrIsCountedAsDropped) {
  constexpr std::uint64_t kTries = 50'000;
  ByteRing ring(16'384);
  std::atomic<bool> done{false};
  std::uint64_t received = 0;
  std::uint64_t previous = 0;
  bool in_order = true;
  std::thread reader([&] {
    for (;;) {
      const bool last_look = done.load();
      if (const auto number = next(ring); number != 0) {
        ++received;
        in_order = in_order && number > previous;
        previous = number;
        ring.release();
      } else if (last_look) {
        return;
      }
    }
  });
  for (std::uint64_t i = 1; i <= kTries; ++i) {
    push(ring, i, (i * 37) % 300);
  }
  done = true;
  reader.join();
  EXPECT_TRUE(in_order);
  EXPECT_EQ(received, ring.pushed());
  EXPECT_EQ(ring.pushed() + ring.dropped(), kTries);
}

TEST(Exchange, AllocatesNothing) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "allocations are not counted under sanitizers";
  }
  LatestValue<Wide> latest;
  SpscRing<Wide, 8> ring;
  ByteRing bytes(4096);
  Wide value{};
  std::uint64_t seen = 0;
  const test::AllocationScope scope;
  for (std::uint32_t i = 0; i < 100; ++i) {
    latest.store(wide(i));
    static_cast<void>(latest.load_newer(value, seen));
    ring.try_push(value);
    static_cast<void>(ring.try_pop(value));
    push(bytes, i, 300);
    static_cast<void>(bytes.next());
    bytes.release();
  }
  EXPECT_EQ(scope.count(), 0U);
}

} // namespace
} // namespace bregma::runtime
