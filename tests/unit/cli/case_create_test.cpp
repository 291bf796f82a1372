// `bregma case create` and `case check` on a round head that is made here.
#include <functional>
#include <sstream>

#include <gtest/gtest.h>

#include "casefile/case.hpp"
#include "casefile/markups.hpp"
#include "tests/unit/casefile/sample_case.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::casefile::NamedPoint;
using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;

constexpr double kRadius_mm = 90.0;

// A ball of 3.1 l in voxels of 6 mm, as NRRD.
std::string ball(double radius_mm) {
  constexpr int kSide = 36;
  constexpr double kSpacing_mm = 6.0;
  std::ostringstream out;
  out << "NRRD0004\ntype: short\ndimension: 3\nspace: right-anterior-superior\nsizes: " << kSide << " " << kSide << " "
      << kSide << "\nspace directions: (6,0,0) (0,6,0) (0,0,6)\nspace origin: (-105,-105,-105)\nencoding: ascii\n\n";
  const auto at = [](int i) { return kSpacing_mm * i - 105.0; };
  for (int k = 0; k < kSide; ++k) {
    for (int j = 0; j < kSide; ++j) {
      for (int i = 0; i < kSide; ++i) {
        const double r = Eigen::Vector3d(at(i), at(j), at(k)).norm();
        out << (r < radius_mm - 3.0 ? 100 : r < radius_mm + 3.0 ? 50 : 0) << (i + 1 < kSide ? ' ' : '\n');
      }
    }
  }
  return out.str();
}

class CaseCreate : public testing::Test {
protected:
  void SetUp() override {
    folder_.write("head.nrrd", ball(kRadius_mm));
    folder_.write("brain.nrrd", ball(65.0));
    folder_.write("tools.toml", "[[tools]]\nname = \"Reference\"\nrole = \"reference\"\n"
                                "markers_mm = [[0, 0, 0], [60, 0, 0], [0, 40, 0]]\n"
                                "[[tools]]\nname = \"Stylus\"\nrole = \"pointer\"\n"
                                "markers_mm = [[0, 0, 0], [60, 0, 0], [0, 40, 0]]\n");
    const double s = kRadius_mm;
    const double d = s * std::sqrt(0.5);
    const NamedPoint fiducials[] = {{"A", {s, 0, 0}}, {"B", {-s, 0, 0}}, {"C", {0, s, 0}}, {"D", {0, 0, s}}};
    const NamedPoint landmarks[] = {{"L", {d, d, 0}}, {"M", {-d, d, 0}}, {"N", {0, d, d}}};
    const NamedPoint target[] = {{"T", {20, 10, 5}}};
    const bregma::casefile::Trajectory path[] = {{"P", {0, d, d}, {20, 10, 5}}};
    using namespace bregma::casefile;
    ASSERT_TRUE(write_points(file("f.mrk.json"), "f", fiducials) && write_points(file("l.mrk.json"), "l", landmarks) &&
                write_points(file("t.mrk.json"), "t", target) && write_trajectories(file("p.mrk.json"), path));
  }

  [[nodiscard]] std::filesystem::path file(const char *name) const { return folder_.path() / name; }

  TemporaryFolder folder_;
};

TEST_F(CaseCreate, WithoutABrainNamesWhatIsMissingAndWhatForAndIsFitForUse) {
  const auto made = run_bregma(folder_, "case create c --image head.nrrd --fiducials f.mrk.json --landmarks l.mrk.json "
                                        "--targets t.mrk.json --trajectories p.mrk.json --tools tools.toml");
  ASSERT_EQ(made.exit_code, 0) << made.err;
  for (const char *part :
       {"structures  critical structures, whose distance from the tip is shown", "--labels",
        "brain       the tissue model, which predicts brain shift; navigation needs none", "--brain"}) {
    EXPECT_NE(made.out.find(part), std::string::npos) << part << "\n" << made.out;
  }
  EXPECT_EQ(made.out.find("landmarks  "), std::string::npos) << "is there\n" << made.out;

  const auto checked = run_bregma(folder_, "case check c");
  EXPECT_EQ(checked.exit_code, 0) << checked.out;
  EXPECT_NE(checked.out.find("brain       the tissue model"), std::string::npos) << checked.out;
  EXPECT_NE(checked.out.find("c: nothing wrong was found"), std::string::npos) << checked.out;
  const auto loaded = bregma::casefile::load_case(file("c"));
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_TRUE(loaded->brain.mesh.triangles.empty());
  EXPECT_FALSE(loaded->craniotomy);

  EXPECT_EQ(run_bregma(folder_, "case show c").exit_code, 0);
  EXPECT_EQ(run_bregma(folder_, "case picture c c.png --size 64").exit_code, 0);
  const auto mesh = run_bregma(folder_, "case mesh c");
  EXPECT_EQ(mesh.exit_code, 2);
  EXPECT_NE(mesh.err.find("c: the case has no brain (surfaces.brain in case.toml)"), std::string::npos) << mesh.err;
  EXPECT_NE(run_bregma(folder_, "tissue shift c").err.find("the case has no brain"), std::string::npos);
  EXPECT_EQ(run_bregma(folder_, "case export c b.stl --surface brain").err,
            "bregma: the case has no surface \"brain\"; it has \"scalp\"\n");
}

TEST_F(CaseCreate, ACaseThatCannotBeVerifiedIsNotFitForUse) {
  const auto made = run_bregma(folder_, "case create c --image head.nrrd --brain brain.nrrd --fiducials f.mrk.json "
                                        "--targets t.mrk.json --tools tools.toml --json");
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const auto missing = made.json()["missing"];
  ASSERT_EQ(missing.size(), 3U) << made.out;
  EXPECT_EQ(missing[0]["part"], "landmarks");
  EXPECT_EQ(missing[0]["needed_to_navigate"], true);
  EXPECT_EQ(missing[1]["part"], "trajectories");
  EXPECT_EQ(missing[2]["part"], "structures");
  const auto checked = run_bregma(folder_, "case check c");
  EXPECT_EQ(checked.exit_code, 1);
  EXPECT_NE(checked.out.find("there are 0 landmarks, a verification checks 3"), std::string::npos) << checked.out;
}

TEST_F(CaseCreate, FiducialsBesideEachOtherAreNotFitForUse) {
  const NamedPoint close[] = {{"A", {kRadius_mm, 0, 0}}, {"B", {kRadius_mm, 3, 0}}, {"C", {kRadius_mm, 0, 4}}};
  ASSERT_TRUE(bregma::casefile::write_points(file("f.mrk.json"), "f", close));
  const auto made = run_bregma(folder_, "case create c --image head.nrrd --fiducials f.mrk.json --landmarks l.mrk.json "
                                        "--targets t.mrk.json --tools tools.toml --snap");
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const auto checked = run_bregma(folder_, "case check c");
  EXPECT_EQ(checked.exit_code, 1);
  EXPECT_NE(checked.out.find("the fiducials lie on a line, or together, within 1."), std::string::npos) << checked.out;
}

TEST_F(CaseCreate, AllPartsThatAreNeededAreNamedAtOnce) {
  const auto run = run_bregma(folder_, "case create c --image head.nrrd");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: a case also needs --fiducials, points on the head that are touched to register the "
                     "patient: at least 3, better 6 to 8; --tools, the reference on the head and the tools that the "
                     "tracker follows (docs/first-case.md)\n");
  EXPECT_FALSE(std::filesystem::exists(file("c")));
}

// Each part is well-formed, and does not belong to the others.
TEST_F(CaseCreate, PartsThatContradictEachOtherAreFound) {
  using bregma::casefile::Case;
  using bregma::tests::sphere;
  ASSERT_EQ(run_bregma(folder_, "case create c --image head.nrrd --brain brain.nrrd --fiducials f.mrk.json "
                                "--landmarks l.mrk.json --targets t.mrk.json --trajectories p.mrk.json "
                                "--tools tools.toml --vertices 1000")
                .exit_code,
            0);
  const auto made = bregma::casefile::load_case(file("c"));
  ASSERT_TRUE(made) << made.error().message;
  const auto both_sides = [](Case &c, double left_x) {
    c.structures = {{"Precentral L", sphere({left_x, 0, 30}, 8, 2)}, {"Precentral R", sphere({-left_x, 0, 30}, 8, 2)}};
  };
  struct Doubt {
    const char *found; // in the answer of the check; empty: nothing
    std::function<void(Case &)> change;
  };
  const Doubt kDoubts[] = {
      {"", [&](Case &c) { both_sides(c, -35.0); }},
      {"\"Precentral L\", \"Precentral R\" lie on the other side than the name says: are the labels mirrored?",
       [&](Case &c) { both_sides(c, 35.0); }},
      {"% of the surface of \"Precentral L\" lie in the brain", [&](Case &c) { both_sides(c, -95.0); }},
      {"% of the brain's surface lie outside of the scalp: are both of one image?",
       [](Case &c) {
         c.brain.mesh = sphere({60, 0, 0}, 65);
       }},
      {"% of the scalp's volume, 20 % to 65 % are usual: are both of one person?",
       [](Case &c) {
         c.brain.mesh = sphere({0, 0, 0}, 42);
       }},
      {"ml, a human brain has 600 to 2200: is it the whole surface of one, in mm?",
       [](Case &c) {
         c.brain.mesh = sphere({0, 0, 0}, 42);
       }},
      {"% of the scalp's volume, 20 % to 65 % are usual",
       [](Case &c) {
         c.brain.mesh = sphere({0, 0, 0}, 86.5);
       }},
      {"there are 2 landmarks, a verification checks 3", [](Case &c) { c.landmarks.pop_back(); }},
      {"there is no target",
       [](Case &c) {
         c.targets.clear();
         c.trajectories.clear();
         c.craniotomy.reset();
       }},
      {"mm deep in the brain: its entry is a point of the skin or of the brain's surface",
       [](Case &c) { c.trajectories[0].entry_mm = c.trajectories[0].target_mm + Eigen::Vector3d(15, 0, 0); }},
      {"trajectory \"P\" is 214 mm long: a probe reaches 150 mm",
       [](Case &c) { c.trajectories[0].entry_mm = c.trajectories[0].target_mm + Eigen::Vector3d(0, 0, 214); }},
  };
  for (const Doubt &doubt : kDoubts) {
    SCOPED_TRACE(doubt.found);
    Case changed = *made;
    doubt.change(changed);
    const auto saved = bregma::casefile::save_case(changed);
    ASSERT_TRUE(saved) << saved.error().message;
    const auto checked = run_bregma(folder_, "case check c");
    EXPECT_EQ(checked.exit_code, *doubt.found == '\0' ? 0 : 1) << checked.out;
    EXPECT_NE(checked.out.find(doubt.found), std::string::npos) << checked.out;
  }
}

} // namespace
