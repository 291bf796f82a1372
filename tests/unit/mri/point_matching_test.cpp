// Correspondence of a phantom's points: lattices that are whole, damaged, cut and turned, and the real markers.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/mri/lattice.hpp"
#include "algorithms/mri/point_matching.hpp"
#include "algorithms/registration/clouds/cpd.hpp"
#include "casefile/markups.hpp"
#include "tests/unit/algorithms/tables.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/mri/field_phantom.hpp"

namespace {

using namespace bregma;
using namespace bregma::mri;
using Eigen::Index;
using Eigen::Vector3d;
using geometry::Points3;

// A phantom in CT, tilted and elsewhere, and in the scanner, in another order.
struct TwoScans {
  Points3 ct, mr;
  std::vector<Index> mr_of; // for each CT point
};
TwoScans scan(const Points3 &phantom, unsigned seed) {
  TwoScans out;
  const geometry::Rigid3<geometry::frame::Target, geometry::frame::Source> tilt(
      geometry::rotation_exp({0.05, -0.08, 0.1}), Vector3d(40.0, -90.0, 15.0));
  out.ct.resize(3, phantom.cols());
  for (Index i = 0; i < phantom.cols(); ++i) {
    out.ct.col(i) = tilt * Vector3d(phantom.col(i));
  }
  out.ct = test::with_noise(out.ct, 0.05, seed + 1);
  std::vector<Index> order(static_cast<std::size_t>(phantom.cols()));
  std::iota(order.begin(), order.end(), Index{0});
  std::mt19937 rng(seed + 2);
  std::shuffle(order.begin(), order.end(), rng);
  const Points3 imaged = test::with_noise(test::SourceField(seed, 3.0).image_of(phantom), 0.15, seed + 3);
  out.mr = imaged(Eigen::all, order);
  out.mr_of.resize(order.size());
  for (std::size_t j = 0; j < order.size(); ++j) {
    out.mr_of[static_cast<std::size_t>(order[j])] = static_cast<Index>(j);
  }
  return out;
}

int wrong(const MatchResult &result, const std::vector<Index> &mr_of) {
  return static_cast<int>(std::count_if(result.pairs.begin(), result.pairs.end(), [&](const MatchedPair &p) {
    return mr_of[static_cast<std::size_t>(p.reference)] != p.imaged;
  }));
}

Points3 without(const Points3 &p, const std::vector<Index> &gone) {
  std::vector<Index> kept;
  for (Index i = 0; i < p.cols(); ++i) {
    if (std::find(gone.begin(), gone.end(), i) == gone.end()) {
      kept.push_back(i);
    }
  }
  return p(Eigen::all, kept);
}

TEST(Lattice, StepsOfATiltedLatticeAreFound) {
  const TwoScans scans = scan(test::lattice(6, 15.0), 1);
  const LatticeSteps lattice = lattice_steps(scans.ct);
  EXPECT_NEAR(lattice.spacing_mm, 15.0, 0.2);
  ASSERT_EQ(lattice.steps_mm.cols(), 3);
  const Eigen::Matrix3d gram = lattice.steps_mm.transpose() * lattice.steps_mm / 225.0;
  EXPECT_LT((gram - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 0.02);
}

TEST(Lattice, ItsBendIsTheDistanceFromAStraightOne) {
  const Points3 straight = test::lattice(7, 15.0);
  Points3 bent = straight;
  for (auto p : bent.colwise()) { // an even function has no affine part
    p.x() += 0.8 * std::cos(0.2 * p.y());
  }
  ASSERT_TRUE(bend_mm(straight) && bend_mm(bent));
  EXPECT_LT(*bend_mm(straight), 1e-9);
  const Eigen::VectorXd shift = (bent - straight).row(0);
  EXPECT_NEAR(*bend_mm(bent), std::sqrt((shift.array() - shift.mean()).square().mean()), 0.02);
  Points3 stretched = straight;
  stretched.row(2) *= 1.03; // is not bent
  EXPECT_LT(*bend_mm(stretched), 1e-9);
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> place(-80.0, 80.0);
  Points3 cloud(3, 201);
  for (auto &coordinate : cloud.reshaped()) {
    coordinate = place(rng);
  }
  EXPECT_FALSE(bend_mm(cloud));
}

TEST(Lattice, NeighboursAreInDifferentHalvesAlsoInAnotherOrderAndWithPointsMissing) {
  Points3 points = without(scan(test::lattice(7, 15.0), 5).ct, {3, 4, 50, 113, 114, 115, 200});
  std::vector<Index> order(static_cast<std::size_t>(points.cols()));
  std::iota(order.begin(), order.end(), Index{0});
  std::shuffle(order.begin(), order.end(), std::mt19937(6));
  points = Points3(points(Eigen::all, order));
  const Halves halves = every_other(points);
  EXPECT_EQ(halves.used.size() + halves.held_out.size(), order.size());
  EXPECT_EQ(halves.used.front(), 0);
  for (const auto &half : {halves.used, halves.held_out}) {
    EXPECT_GT(half.size(), order.size() * 2 / 5);
    const std::vector<double> nearest = nearest_distances(points(Eigen::all, half));
    EXPECT_GT(*std::min_element(nearest.begin(), nearest.end()), 1.3 * 15.0); // the diagonal of a cell's side
  }
}

TEST(Lattice, WithoutOneEveryOtherColumnIsHeldOut) {
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> place(-80.0, 80.0);
  Points3 points(3, 201);
  for (auto &coordinate : points.reshaped()) {
    coordinate = place(rng);
  }
  const Halves halves = every_other(points);
  ASSERT_EQ(halves.used.size(), 101u);
  ASSERT_EQ(halves.held_out.size(), 100u);
  for (std::size_t i = 0; i < halves.held_out.size(); ++i) {
    EXPECT_EQ(halves.held_out[i], static_cast<Index>(2 * i + 1));
  }
}

TEST(PointMatching, AWholeLatticeIsMatchedInAnyOrder) {
  for (unsigned seed = 0; seed < 2; ++seed) {
    const TwoScans scans = scan(test::lattice(7, 17.0), seed);
    const MatchResult result = match_points(scans.ct, scans.mr);
    ASSERT_EQ(result.outcome, MatchOutcome::kMatched) << name(result.outcome);
    EXPECT_EQ(result.pairs.size(), 343u);
    EXPECT_EQ(wrong(result, scans.mr_of), 0);
    EXPECT_TRUE(result.reference_unmatched.empty() && result.imaged_unmatched.empty());
    const Points3 shift = result.imaged_points(scans.mr) - result.reference_points(scans.ct);
    EXPECT_LT(shift.colwise().norm().maxCoeff(), 15.0);
  }
}

TEST(PointMatching, MissingDoubledAndForeignPointsAreListedByReason) {
  TwoScans scans = scan(test::lattice(7, 17.0), 9);
  // CT sees a marker on the couch; MR lost three points, doubled one, and has one far off its place.
  const Index ct_count = scans.ct.cols();
  scans.ct.conservativeResize(3, ct_count + 1);
  scans.ct.col(ct_count) = scans.ct.rowwise().maxCoeff() + Vector3d(60.0, 0.0, 0.0);
  const std::vector<Index> lost = {5, 100, 200};
  std::vector<Index> lost_mr;
  for (const Index i : lost) {
    lost_mr.push_back(scans.mr_of[static_cast<std::size_t>(i)]);
  }
  const Index doubled = scans.mr_of[50], displaced = scans.mr_of[171];
  scans.mr.col(displaced) += Vector3d(0.0, 4.0, 0.0);
  Points3 mr(3, scans.mr.cols() + 1);
  mr << scans.mr, scans.mr.col(doubled) + Vector3d(3.0, 2.0, 0.0);
  const Points3 imaged = without(mr, lost_mr);
  const MatchResult result = match_points(scans.ct, imaged);
  ASSERT_EQ(result.outcome, MatchOutcome::kMatched) << name(result.outcome);
  EXPECT_EQ(result.pairs.size(), 339u);
  for (const MatchedPair &p : result.pairs) {
    const Index expected = scans.mr_of[static_cast<std::size_t>(p.reference)];
    EXPECT_LT((imaged.col(p.imaged) - scans.mr.col(expected)).norm(), 1e-9);
  }
  std::vector<std::pair<Index, UnmatchedReason>> reasons;
  for (const UnmatchedPoint &u : result.reference_unmatched) {
    reasons.emplace_back(u.index, u.reason);
  }
  EXPECT_EQ(reasons, (std::vector<std::pair<Index, UnmatchedReason>>{{5, UnmatchedReason::kNoPartner},
                                                                     {100, UnmatchedReason::kNoPartner},
                                                                     {171, UnmatchedReason::kOffField},
                                                                     {200, UnmatchedReason::kNoPartner},
                                                                     {343, UnmatchedReason::kIsolated}}));
  ASSERT_EQ(result.imaged_unmatched.size(), 2u);
  const auto doubled_at = std::find_if(result.imaged_unmatched.begin(), result.imaged_unmatched.end(),
                                       [](const auto &u) { return u.reason == UnmatchedReason::kDoubled; });
  ASSERT_NE(doubled_at, result.imaged_unmatched.end());
  EXPECT_EQ(doubled_at->index, imaged.cols() - 1);
}

TEST(PointMatching, AListThatIsWrittenTwiceIsOneOfDoubledPoints) {
  const TwoScans scans = scan(test::lattice(6, 17.0), 3);
  Points3 twice(3, 2 * scans.mr.cols());
  twice << scans.mr, scans.mr;
  const MatchResult result = match_points(scans.ct, twice);
  ASSERT_EQ(result.outcome, MatchOutcome::kMatched) << name(result.outcome);
  EXPECT_EQ(result.pairs.size(), 216u);
  EXPECT_EQ(wrong(result, scans.mr_of), 0);
  ASSERT_EQ(result.imaged_unmatched.size(), 216u);
  for (const UnmatchedPoint &u : result.imaged_unmatched) {
    EXPECT_GE(u.index, 216);
    EXPECT_EQ(u.reason, UnmatchedReason::kDoubled);
  }
}

TEST(PointMatching, ALatticeThatIsCutOffOneCellMayLieElsewhere) {
  const Points3 phantom = test::lattice(8, 17.0);
  TwoScans scans = scan(phantom, 3);
  std::vector<Index> outside; // the scanner's field of view leaves out a layer at each end of x
  for (Index i = 0; i < phantom.cols(); ++i) {
    if (std::abs(phantom(0, i)) > 50.0) {
      outside.push_back(scans.mr_of[static_cast<std::size_t>(i)]);
    }
  }
  const MatchResult result = match_points(scans.ct, without(scans.mr, outside));
  ASSERT_EQ(result.outcome, MatchOutcome::kAmbiguous) << name(result.outcome);
  ASSERT_TRUE(result.alternative);
  EXPECT_NEAR(result.alternative->shift_mm, 17.0, 1.5);
  EXPECT_EQ(result.alternative->pairs, 6 * 64);
}

TEST(PointMatching, ACubeOfUnknownOrientationIsAmbiguousAndAnAsymmetricPhantomIsNot) {
  MatchOptions unknown;
  unknown.same_orientation = false;
  const TwoScans cube = scan(test::lattice(6, 17.0), 4);
  const MatchResult result = match_points(cube.ct, cube.mr, unknown);
  ASSERT_EQ(result.outcome, MatchOutcome::kAmbiguous) << name(result.outcome);
  ASSERT_TRUE(result.alternative);
  const double quarters = result.alternative->rotation_rad / (0.5 * M_PI);
  EXPECT_GT(quarters, 0.9);

  Points3 phantom = test::lattice(6, 17.0);
  std::vector<Index> corner; // a block without symmetry is missing
  for (Index i = 0; i < phantom.cols(); ++i) {
    if (phantom(0, i) > 0.0 && phantom(1, i) > 20.0 && phantom(2, i) > -20.0) {
      corner.push_back(i);
    }
  }
  const TwoScans marked = scan(without(phantom, corner), 4);
  const MatchResult found = match_points(marked.ct, marked.mr, unknown);
  ASSERT_EQ(found.outcome, MatchOutcome::kMatched) << name(found.outcome);
  EXPECT_EQ(wrong(found, marked.mr_of), 0);
}

TEST(PointMatching, PointsThatDoNotBelongTogetherAreNotMatched) {
  const Points3 phantom = test::lattice(6, 17.0);
  std::mt19937 rng(6);
  std::uniform_real_distribution<double> side(-60.0, 60.0);
  const Points3 cloud = Points3::NullaryExpr(3, 200, [&] { return side(rng); });
  EXPECT_NE(match_points(phantom, cloud).outcome, MatchOutcome::kMatched);
  EXPECT_EQ(match_points(phantom.leftCols(11), phantom).outcome, MatchOutcome::kTooFewPoints);
  Points3 broken = phantom;
  broken(0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(match_points(broken, phantom).outcome, MatchOutcome::kTooFewPoints);
}

Points3 markers(const std::filesystem::path &file) {
  const auto points = casefile::read_points(file);
  if (!points) {
    ADD_FAILURE() << points.error().message;
    return {};
  }
  Points3 out(3, static_cast<Index>(points->size()));
  for (std::size_t i = 0; i < points->size(); ++i) {
    out.col(static_cast<Index>(i)) = (*points)[i].position_mm;
  }
  return out;
}

// The index of the point that lies within 0.1 mm; -1: none.
Index same_point(const Points3 &points, const Vector3d &at) {
  Index index = -1;
  return (points.colwise() - at).colwise().norm().minCoeff(&index) < 0.1 ? index : -1;
}

// Files of markers are LPS and become RAS here; the table has the numbers of the files.
Points3 flipped(Points3 p) {
  p.topRows<2>() *= -1.0;
  return p;
}

TEST(PointMatching, TheRealPhantomsMarkersAreMatchedWithoutHandWork) {
  BREGMA_SHARED_DATA(folder, "distortion/repeat");
  const Points3 ct = markers(folder / "CT.mrk.json");
  const Points3 mean = flipped(test::read_points<3>(folder / "Matched_Markers.csv", 1, 1));
  const Points3 truth = flipped(test::read_points<3>(folder / "Matched_Markers.csv", 1, 5));
  const Points3 half = flipped(test::read_points<3>(folder / "Matched_Markers.csv", 1, 9));
  ASSERT_EQ(ct.cols(), 339);
  // The table's true positions are those of CT after a rigid motion that it does not state.
  const auto motion = registration::register_cpd<3>(truth, ct, {});
  const Points3 truth_in_ct = motion.transform * truth;
  for (const auto &[file, sign] : {std::pair("MR_AP.mrk.json", -1.0), std::pair("MR_PA.mrk.json", 1.0)}) {
    const Points3 mr = markers(folder / file);
    const MatchResult result = match_points(ct, mr);
    ASSERT_EQ(result.outcome, MatchOutcome::kMatched) << file << ": " << name(result.outcome);
    int right = 0, contradicted = 0;
    for (Index row = 0; row < truth.cols(); ++row) {
      const Index reference = same_point(ct, truth_in_ct.col(row));
      const Index imaged = same_point(mr, mean.col(row) + sign * half.col(row));
      ASSERT_GE(reference, 0) << "row " << row;
      for (const MatchedPair &p : result.pairs) {
        right += p.reference == reference && p.imaged == imaged ? 1 : 0;
        contradicted += p.reference == reference && imaged >= 0 && p.imaged != imaged ? 1 : 0;
      }
    }
    EXPECT_GE(right, 334) << file;
    EXPECT_EQ(contradicted, 0) << file;
    ASSERT_GE(result.reference_unmatched.size(), 3u);
    for (Index i = 336; i < 339; ++i) { // three markers far from the phantom
      const auto u = std::find_if(result.reference_unmatched.begin(), result.reference_unmatched.end(),
                                  [&](const UnmatchedPoint &point) { return point.index == i; });
      ASSERT_NE(u, result.reference_unmatched.end());
      EXPECT_EQ(u->reason, UnmatchedReason::kIsolated);
    }
  }
}

TEST(PointMatching, WrongPairsOfTheOlderTableAreNamed) {
  BREGMA_SHARED_DATA(file, "distortion/MatchedMarkerVolume.csv");
  const Points3 imaged = test::read_points<3>(file, 1, 1), truth = test::read_points<3>(file, 1, 5);
  std::vector<Index> rows;
  for (const MatchedPair &p : wrong_pairs(truth, imaged)) {
    rows.push_back(p.reference);
    EXPECT_GT(p.residual_mm, 4.0);
  }
  EXPECT_EQ(rows, (std::vector<Index>{153, 174, 209}));
}

TEST(PointMatching, ACleanTableHasNoWrongPairs) {
  BREGMA_SHARED_DATA(file, "distortion/repeat/Matched_Markers.csv");
  EXPECT_TRUE(wrong_pairs(test::read_points<3>(file, 1, 5), test::read_points<3>(file, 1, 1)).empty());
}

} // namespace
