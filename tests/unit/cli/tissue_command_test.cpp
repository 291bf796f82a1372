#include <sstream>

#include <gtest/gtest.h>

#include "tests/unit/casefile/sample_case.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::read_file;
using bregma::tests::run_bregma;

// A probe in a ball with a coarse mesh.
constexpr const char *kInsert = "tissue insert ball --elements 10000 --speed 20 ";

class TissueInsert : public testing::Test {
protected:
  void SetUp() override { save(bregma::tests::sample_case(folder_.path() / "ball")); }

  void save(const bregma::casefile::Case &c) const {
    folder_.write((c.folder.filename() / "image.nii.gz").string(), "not read here");
    const auto saved = bregma::casefile::save_case(c);
    ASSERT_TRUE(saved) << saved.error().message;
  }

  // The last line that begins with the program's name; progress lines precede it.
  std::string error_of(const std::string &arguments) const {
    const auto run = run_bregma(folder_, arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments;
    EXPECT_EQ(run.out, "") << arguments;
    const auto at = run.err.find("bregma: ");
    return at == std::string::npos ? run.err : run.err.substr(at);
  }

  TemporaryFolder folder_;
};

TEST(TissueMaterials, TheTableHasModuliAndSources) {
  const TemporaryFolder folder;
  const auto run = run_bregma(folder, "tissue materials");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.out.rfind("material", 0), 0U);
  for (const char *text : {"thesis", "miller-chinzei", "linear", "Ogden, alpha -4.7", "J Biomech 35 (2002)",
                           "1.24e8 Pa and 6.20e6 Pa besides E and nu, which contradicts them"}) {
    EXPECT_NE(run.out.find(text), std::string::npos) << text << "\n" << run.out;
  }
  const auto json = run_bregma(folder, "tissue materials --json").json()["materials"];
  ASSERT_EQ(json.size(), 3U);
  EXPECT_EQ(json[0]["name"], "thesis");
  EXPECT_NEAR(json[0]["bulk_Pa"].get<double>(), 2100.0 / (3.0 * 0.1), 1e-6);
  EXPECT_NEAR(json[0]["shear_Pa"].get<double>(), 2100.0 / (2.0 * 1.45), 1e-6);
  EXPECT_TRUE(json[0]["ogden_alpha"].is_null());
  EXPECT_NEAR(json[1]["shear_Pa"].get<double>(), 842.0, 1e-6);
  EXPECT_NEAR(json[1]["relaxed_shear_Pa"].get<double>(), 842.0 * (1.0 - 0.450 - 0.365), 1e-6);
}

TEST_F(TissueInsert, TheProbeIndentsRupturesAndHasFriction) {
  const auto run = run_bregma(folder_, std::string(kInsert) + "--depth 25 --csv run.csv --vtu end.vtu --json");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  bregma::tests::expect_lost_output_is_said(folder_, std::string(kInsert) + "--depth 25");
  const auto json = run.json();
  EXPECT_EQ(json["trajectory"], "Biopsy");
  EXPECT_EQ(json["material"], "thesis");
  EXPECT_LE(json["invalid_updates"].get<int>(), 5) << "as the tissue snaps back";
  EXPECT_EQ(json["ruptures"], 1);
  EXPECT_GT(json["rupture_force_N"].get<double>(), 0.06);
  const auto &updates = json["updates"];
  EXPECT_EQ(updates.front()["phase"], "outside");
  EXPECT_LT(updates.front()["depth_mm"].get<double>(), -5.0);
  EXPECT_EQ(updates.back()["phase"], "penetration");
  EXPECT_NEAR(updates.back()["depth_mm"].get<double>(), 25.0, 1e-9);
  // The phases are in order, and the target moves with the probe.
  int phase = 0;
  for (const auto &update : updates) {
    const std::string name = update["phase"];
    const int now = name == "outside" ? 0 : name == "indentation" ? 1 : 2;
    EXPECT_GE(now, phase) << update;
    phase = now;
  }
  EXPECT_EQ(updates.front()["target_motion_mm"], 0.0);
  EXPECT_GT(updates.back()["target_motion_mm"].get<double>(), 0.01);
  EXPECT_GT(updates.back()["target_error_bound_mm"].get<double>(), 0.002);
  EXPECT_LT(updates.back()["target_motion_mm"].get<double>(), 10.0);

  std::istringstream csv(read_file(folder_.path() / "run.csv"));
  std::string line;
  std::size_t rows = 0;
  ASSERT_TRUE(std::getline(csv, line));
  const auto columns = std::count(line.begin(), line.end(), ',');
  EXPECT_EQ(line.rfind("time_s,depth_mm,phase,status,reason,tip_force_N,", 0), 0U);
  while (std::getline(csv, line)) {
    ++rows;
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), columns) << line;
  }
  EXPECT_EQ(rows, updates.size());
  const std::string vtu = read_file(folder_.path() / "end.vtu");
  for (const char *field : {"displacement_mm", "von_mises_Pa", "cauchy_Pa"}) {
    EXPECT_NE(vtu.find("Name=\"" + std::string(field) + "\""), std::string::npos) << field;
  }
}

TEST_F(TissueInsert, TheTableHasOneRowPerMillimetre) {
  const auto run = run_bregma(folder_, std::string(kInsert) + "--depth 5");
  EXPECT_EQ(run.exit_code, 0) << run.out << run.err;
  EXPECT_EQ(run.out.rfind("Trajectory Biopsy, ", 0), 0U) << run.out;
  EXPECT_NE(run.out.find("depth mm  phase"), std::string::npos) << run.out;
  const auto lines = std::count(run.out.begin(), run.out.end(), '\n');
  EXPECT_GE(lines, 13 + 5) << "13 mm in rows, and the lines around them\n" << run.out;
  EXPECT_LE(lines, 13 + 12) << run.out;
  EXPECT_NE(run.out.find(" of them invalid.\n"), std::string::npos) << run.out;
  EXPECT_EQ(run.err, "  0 %  case\n  2 %  tetrahedra\n 10 %  insertion\n");
}

TEST_F(TissueInsert, UsesTheCasesMaterial) {
  bregma::casefile::Case c = bregma::tests::sample_case(folder_.path() / "ball");
  c.tissue = {.material = "linear",
              .young_Pa = 1000.0,
              .poisson = std::nullopt,
              .density_kg_m3 = std::nullopt,
              .ogden_alpha = std::nullopt};
  save(c);
  const std::string command = std::string(kInsert) + "--depth 1 --json";
  const auto soft = run_bregma(folder_, command).json();
  EXPECT_EQ(soft["material"], "linear");
  c.tissue->young_Pa = 2000.0;
  save(c);
  const auto stiff = run_bregma(folder_, command).json();
  EXPECT_GT(stiff["updates"].back()["tip_force_N"].get<double>(),
            1.5 * soft["updates"].back()["tip_force_N"].get<double>());
}

TEST_F(TissueInsert, AnImpossibleInsertionIsOneSentence) {
  EXPECT_EQ(error_of("tissue insert ball --trajectory Bipsy"),
            "bregma: --trajectory \"Bipsy\": ball has no such trajectory; there are \"Biopsy\"\n");
  EXPECT_EQ(error_of("tissue insert ball --speed 0"),
            "bregma: --speed: Value 0 not in range 0.100000 to 100.000000 (see bregma tissue insert --help)\n");
  EXPECT_EQ(error_of("tissue insert ball --elements 5"),
            "bregma: --elements: Value 5 not in range 10000 to 100000 (see bregma tissue insert --help)\n");
  EXPECT_EQ(error_of(std::string(kInsert) + "--depth 0.5 --csv none/run.csv"),
            "bregma: none/run.csv: cannot be written: No such file or directory\n");

  bregma::casefile::Case c = bregma::tests::sample_case(folder_.path() / "ball");
  c.trajectories[0].entry_mm = {0.0, 0.0, 60.0};
  save(c);
  EXPECT_EQ(error_of("tissue insert ball"),
            "bregma: ball: trajectory \"Biopsy\" begins inside the brain: its entry is not known\n");
  c.trajectories.clear();
  save(c);
  EXPECT_EQ(error_of("tissue insert ball"), "bregma: ball: the case has no trajectory to insert along\n");
}

class TissueShift : public TissueInsert {
protected:
  // A ball would rotate in its skull: the part without buoyancy is heavy and on top.
  void SetUp() override {
    bregma::casefile::Case c = bregma::tests::sample_case(folder_.path() / "egg");
    for (Eigen::Vector3d &vertex : c.brain.mesh.vertices_mm) {
      vertex.x() *= 0.8;
      vertex.z() = 5.0 + 0.9 * (vertex.z() - 5.0);
    }
    save(c);
  }
};

TEST_F(TissueShift, TheBrainSinksWithItsTargetsAndLandmarks) {
  const auto run = run_bregma(folder_, "tissue shift egg --elements 10000 --fluid-drop 20 --vtu shift.vtu --json");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  const auto json = run.json();
  EXPECT_EQ(json["converged"], true);
  EXPECT_EQ(json["inverted_elements"], 0);
  EXPECT_EQ(json["fluid_drop_mm"], 20.0);
  ASSERT_EQ(json["points"].size(), 2U);
  EXPECT_EQ(json["points"][0]["name"], "Lesion");
  EXPECT_EQ(json["points"][1]["kind"], "landmark");
  for (const auto &point : json["points"]) {
    EXPECT_LT(point["displacement_mm"][1].get<double>(), -0.1) << "supine: things fall backwards";
    EXPECT_GT(point["displacement_mm"][1].get<double>(), -30.0);
  }
  bregma::tests::expect_lost_output_is_said(folder_, "tissue shift egg --elements 10000 --fluid-drop 20");
  const std::string vtu = read_file(folder_.path() / "shift.vtu");
  EXPECT_NE(vtu.find("Name=\"displacement_mm\""), std::string::npos);
}

TEST_F(TissueShift, WithoutAChangeOfLoadNothingMoves) {
  const auto run = run_bregma(folder_, "tissue shift egg --elements 10000 --fluid-drop 0");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  EXPECT_EQ(run.out.rfind("Head supine, imaged supine; fluid 0.0 mm below", 0), 0U) << run.out;
  EXPECT_NE(run.out.find("Lesion"), std::string::npos) << run.out;
  const auto turned =
      run_bregma(folder_, "tissue shift egg --elements 10000 --fluid-drop 0 --posture left-down --json");
  EXPECT_LT(turned.json()["points"][0]["displacement_mm"][0].get<double>(), 0.0) << "weight less buoyancy has turned";
  const auto still = run_bregma(folder_, "tissue shift egg --elements 10000 --fluid-drop 0 --json").json();
  for (const auto &along : still["points"][0]["displacement_mm"]) {
    EXPECT_NEAR(along.get<double>(), 0.0, 1e-3);
  }
}

TEST_F(TissueShift, AnImpossibleShiftIsOneSentence) {
  EXPECT_EQ(error_of("tissue shift nowhere"), "bregma: nowhere: is not a folder; a case is a folder with case.toml\n");
  EXPECT_NE(error_of("tissue shift egg --posture upside-down").find("--posture: upside-down not in {"),
            std::string::npos);
  EXPECT_NE(error_of("tissue shift egg --gap -1").find("--gap: Value -1 not in range"), std::string::npos);
}

} // namespace
