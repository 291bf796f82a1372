// What explains pairs of points that do not fit.
#include "algorithms/registration/points/explanations.hpp"

#include <algorithm>
#include <numeric>
#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace bregma::registration {
namespace {

using Kind = Explanation::Kind;
constexpr double kLimit_mm = 3.0;

// Points of a head and their images with an error of 0.5 mm per coordinate.
struct Lists {
  explicit Lists(unsigned seed, int count = 10) {
    std::mt19937 rng(seed);
    std::normal_distribution<double> normal;
    const Eigen::Isometry3d T = Eigen::Translation3d(120, -45, 300) *
                                Eigen::AngleAxisd(0.4, Vector3d(normal(rng), normal(rng), normal(rng)).normalized());
    for (int i = 0; i < count; ++i) {
      source.push_back(90.0 * Vector3d(normal(rng), normal(rng), normal(rng)).normalized());
      target.push_back(T * source.back() + 0.5 * Vector3d(normal(rng), normal(rng), normal(rng)));
    }
  }
  std::vector<Vector3d> source, target;
};

const Explanation *first_of(const std::vector<Explanation> &all) { return all.empty() ? nullptr : &all.front(); }

TEST(Explanations, TheRelationThatWasAppliedIsTheFirst) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE(seed);
    Lists mirrored(seed);
    for (Vector3d &point : mirrored.source) {
      point.x() = -point.x();
    }
    const auto mirror = explain(mirrored.source, mirrored.target, kLimit_mm);
    ASSERT_TRUE(first_of(mirror));
    EXPECT_EQ(mirror.front().kind, Kind::kMirrored);

    Lists scaled(seed);
    for (Vector3d &point : scaled.source) {
      point /= 25.4;
    }
    const auto scale = explain(scaled.source, scaled.target, kLimit_mm);
    ASSERT_TRUE(first_of(scale));
    EXPECT_EQ(scale.front().kind, Kind::kScaled);
    EXPECT_NEAR(scale.front().scale, 25.4, 0.5);

    Lists moved(seed);
    std::vector<std::size_t> order(moved.source.size());
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(order.begin(), order.end(), std::mt19937(seed));
    auto in_order = moved.target;
    for (std::size_t i = 0; i < order.size(); ++i) {
      in_order[order[i]] = moved.target[i];
    }
    const auto other = explain(moved.source, in_order, kLimit_mm);
    ASSERT_TRUE(first_of(other));
    EXPECT_EQ(other.front().kind, Kind::kReordered);
    EXPECT_EQ(other.front().indices, order);

    Lists wrong(seed);
    wrong.target[3] += Vector3d(0, 29.7, 0);
    const auto one = explain(wrong.source, wrong.target, kLimit_mm);
    ASSERT_TRUE(first_of(one));
    EXPECT_EQ(one.front().kind, Kind::kWrongPairs);
    EXPECT_EQ(one.front().indices, std::vector<std::size_t>{3});

    wrong.target[7] += Vector3d(25, 0, 10);
    const auto two = explain(wrong.source, wrong.target, kLimit_mm);
    ASSERT_TRUE(first_of(two));
    EXPECT_EQ(two.front().kind, Kind::kWrongPairs);
    EXPECT_EQ(two.front().indices, (std::vector<std::size_t>{3, 7}));
  }
}

TEST(Explanations, PointsThatFitOrThatNothingExplainsHaveNone) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Lists good(seed);
    EXPECT_TRUE(explain(good.source, good.target, kLimit_mm).empty()) << seed;
    EXPECT_TRUE(explain(good.source, Lists(seed + 100).target, kLimit_mm).empty()) << seed;
  }
}

TEST(Explanations, PointsInAPlaneAreNeverCalledMirrored) {
  Lists flat(1);
  for (std::size_t i = 0; i < flat.source.size(); ++i) {
    flat.source[i].z() = 0.0;
    flat.target[i] = Vector3d(-flat.source[i].x(), flat.source[i].y(), 0.0); // a mirror image and a turn over
  }
  EXPECT_TRUE(are_coplanar(flat.source));
  EXPECT_TRUE(explain(flat.source, flat.target, kLimit_mm).empty());
}

TEST(Explanations, AnOddPairIsFoundWhereTheResidualsAsAWholeLookAcceptable) {
  int found = 0;
  int false_alarms = 0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    Lists lists(seed);
    false_alarms += find_odd_pair(lists.source, lists.target, kLimit_mm) ? 1 : 0;
    lists.target[4] += Vector3d(8, 0, 0);
    const auto odd = find_odd_pair(lists.source, lists.target, kLimit_mm);
    found += odd && odd->index == 4 ? 1 : 0;
  }
  EXPECT_EQ(false_alarms, 0);
  EXPECT_GE(found, 98);
}

} // namespace
} // namespace bregma::registration
