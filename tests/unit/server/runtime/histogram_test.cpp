#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "server/runtime/histogram.hpp"

namespace bregma::runtime {
namespace {

TEST(Histogram, AnEmptyHistogramGivesZero) {
  EXPECT_EQ(Histogram().snapshot().percentile_ns(0.5), 0.0);
  EXPECT_EQ(Histogram().snapshot().total, 0U);
}

TEST(Histogram, SmallValuesAreExactAndNegativeOnesAreZero) {
  Histogram histogram;
  for (const std::int64_t value : {-5, 3, 7, 31}) {
    histogram.add(value);
  }
  const auto snapshot = histogram.snapshot();
  EXPECT_EQ(snapshot.percentile_ns(0.0), 0.0);
  EXPECT_EQ(snapshot.percentile_ns(0.5), 3.0);
  EXPECT_EQ(snapshot.percentile_ns(0.75), 7.0);
  EXPECT_EQ(snapshot.percentile_ns(1.0), 31.0);
  EXPECT_EQ(snapshot.max_ns, 31);
}

TEST(Histogram, ClassesAreContiguousAndContainTheirMiddle) {
  for (std::size_t i = 0; i < detail::kClasses; ++i) {
    const double middle = detail::value_of(i);
    EXPECT_EQ(detail::class_of(static_cast<std::uint64_t>(middle)), i);
    if (i > 0) {
      EXPECT_GT(middle, detail::value_of(i - 1));
    }
  }
  EXPECT_EQ(detail::class_of(~std::uint64_t{0}), detail::kClasses - 1);
}

TEST(Histogram, PercentilesAgreeWithTheSortedSamples) {
  constexpr unsigned kSeed = 5;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::lognormal_distribution<double> duration(std::log(120e3), 1.5);
  Histogram histogram;
  std::vector<std::int64_t> sorted;
  for (int i = 0; i < 50'000; ++i) {
    sorted.push_back(static_cast<std::int64_t>(duration(random)));
    histogram.add(sorted.back());
  }
  std::sort(sorted.begin(), sorted.end());
  const auto snapshot = histogram.snapshot();
  for (const double fraction : {0.01, 0.5, 0.9, 0.99, 0.999}) {
    const auto rank = static_cast<std::size_t>(std::ceil(fraction * 50'000.0)) - 1;
    const auto exact = static_cast<double>(sorted[rank]);
    EXPECT_NEAR(snapshot.percentile_ns(fraction), exact, 0.016 * exact) << fraction;
  }
  EXPECT_EQ(snapshot.max_ns, sorted.back());
  EXPECT_EQ(snapshot.total, sorted.size());
}

TEST(Histogram, CountsSinceTheLastSnapshot) {
  Histogram histogram;
  for (int i = 0; i < 1000; ++i) {
    histogram.add(1'000);
  }
  const auto before = histogram.snapshot();
  histogram.add(2'000'000);
  const auto since = histogram.snapshot().since(before);
  EXPECT_EQ(since.total, 1U);
  EXPECT_NEAR(since.percentile_ns(0.5), 2e6, 0.016 * 2e6);
}

} // namespace
} // namespace bregma::runtime
