#include <gtest/gtest.h>

#include "tests/unit/casefile/sample_case.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;

class CaseMesh : public testing::Test {
protected:
  void SetUp() override {
    folder_.write("ball/image.nii.gz", "not read here");
    const auto saved = bregma::casefile::save_case(bregma::tests::sample_case(folder_.path() / "ball"));
    ASSERT_TRUE(saved) << saved.error().message;
  }

  TemporaryFolder folder_;
};

TEST_F(CaseMesh, ReportsTheQualityAndWritesTheMesh) {
  const auto run = run_bregma(folder_, "case mesh ball --elements 12000");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.out.rfind("of the mesh", 0), 0U) << run.out;
  for (const char *row :
       {"tetrahedra", "nodes", "edge of the lattice", "volume in the surface", "dihedral angle, smallest",
        "dihedral angle, largest", "radius ratio, smallest", "ms, material thesis", "Written: ball/tissue.vtu"}) {
    EXPECT_NE(run.out.find(row), std::string::npos) << row << "\n" << run.out;
  }
  EXPECT_EQ(run.err, "  0 %  case\n 10 %  tetrahedra\n 90 %  file\n");
  const std::string vtu = bregma::tests::read_file(folder_.path() / "ball/tissue.vtu");
  EXPECT_NE(vtu.find("UnstructuredGrid"), std::string::npos);
  EXPECT_NE(vtu.find("Name=\"radius_ratio\""), std::string::npos);
  EXPECT_NE(vtu.find("Name=\"stable_length_mm\""), std::string::npos);
}

TEST_F(CaseMesh, JsonFiguresMatchABall) {
  const auto json = run_bregma(folder_, "case mesh ball --edge 10 --out other.vtu --json").json();
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["file"], "other.vtu");
  EXPECT_TRUE(std::filesystem::exists(folder_.path() / "other.vtu"));
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "ball/tissue.vtu"));
  EXPECT_EQ(json["lattice_edge_mm"], 10.0);
  const double ball_mm3 = 4.0 / 3.0 * M_PI * 70.0 * 70.0 * 70.0;
  EXPECT_NEAR(json["surface_volume_mm3"].get<double>(), ball_mm3, 0.03 * ball_mm3) << "of a coarse ball";
  EXPECT_NEAR(json["volume_mm3"].get<double>(), json["surface_volume_mm3"].get<double>(), 0.02 * ball_mm3);
  EXPECT_NEAR(json["tetrahedra"].get<double>(), 12.0 * ball_mm3 / 1000.0, 3000.0);
  EXPECT_GT(json["min_dihedral_deg"].get<double>(), 10.0);
  EXPECT_LT(json["max_dihedral_deg"].get<double>(), 165.0);
  EXPECT_GT(json["stable_step_s"].get<double>(), 1e-4);
  EXPECT_LT(json["stable_step_s"].get<double>(), 5e-3);
}

TEST_F(CaseMesh, NoOutputReplacesAFileOfTheCase) {
  const std::string toml = bregma::tests::read_file(folder_.path() / "ball/case.toml");
  for (const char *arguments :
       {"case mesh ball --out ball/case.toml", "case picture ball ball/image.nii.gz",
        "case export ball ball/surfaces/scalp.ply --force", "tissue shift ball --vtu ball/targets.mrk.json",
        "tissue insert ball --csv ball/surfaces/../case.toml"}) {
    const auto run = run_bregma(folder_, arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments;
    EXPECT_NE(run.err.find("is a file of the case: it is not written over"), std::string::npos) << run.err;
  }
  EXPECT_EQ(bregma::tests::read_file(folder_.path() / "ball/case.toml"), toml);
  EXPECT_EQ(bregma::tests::read_file(folder_.path() / "ball/image.nii.gz"), "not read here");
  EXPECT_EQ(run_bregma(folder_, "case picture ball ball/ball.png --size 64").exit_code, 0);
  EXPECT_EQ(run_bregma(folder_, "case picture ball ball/ball.png --size 64").exit_code, 0) << "may be made again";
}

TEST_F(CaseMesh, TheStepUsesTheCasesMaterial) {
  bregma::casefile::Case c = bregma::tests::sample_case(folder_.path() / "ball");
  const auto step_s = [this] {
    return run_bregma(folder_, "case mesh ball --edge 10 --json").json()["stable_step_s"].get<double>();
  };
  const double before = step_s();
  c.tissue = {.material = "thesis",
              .young_Pa = 4.0 * 2100.0,
              .poisson = std::nullopt,
              .density_kg_m3 = std::nullopt,
              .ogden_alpha = std::nullopt};
  c.craniotomy = {.trajectory = "Biopsy", .radius_mm = 17.5};
  ASSERT_TRUE(bregma::casefile::save_case(c));
  EXPECT_NEAR(step_s(), 0.5 * before, 1e-9) << "four times as stiff, twice as fast waves";

  const auto shown = run_bregma(folder_, "case show ball").out;
  EXPECT_NE(shown.find("Craniotomy where Biopsy enters the brain, radius 17.5 mm\n"), std::string::npos) << shown;
  EXPECT_NE(shown.find("Brain of thesis: E 8400 Pa, nu 0.450, 1000 kg/m^3\n"), std::string::npos) << shown;
  const auto json = run_bregma(folder_, "case show ball --json").json();
  EXPECT_EQ(json["craniotomy"]["trajectory"], "Biopsy");
  EXPECT_EQ(json["material"]["young_Pa"], 8400.0);
}

TEST_F(CaseMesh, OtherNumbersOfElementsAreRefused) {
  const auto error_of = [this](const std::string &options) {
    const auto run = run_bregma(folder_, "case mesh ball " + options);
    EXPECT_EQ(run.exit_code, 2) << options;
    EXPECT_EQ(run.out, "") << options;
    EXPECT_FALSE(std::filesystem::exists(folder_.path() / "ball/tissue.vtu")) << options;
    const auto at = run.err.find("bregma: ");
    return at == std::string::npos ? run.err : run.err.substr(at);
  };
  const std::string help = " (see bregma case mesh --help)\n";
  EXPECT_EQ(error_of("--elements 9999"), "bregma: --elements: Value 9999 not in range 10000 to 100000" + help);
  EXPECT_EQ(error_of("--elements 100001"), "bregma: --elements: Value 100001 not in range 10000 to 100000" + help);
  EXPECT_EQ(error_of("--elements 20000 --edge 8"), "bregma: --elements excludes --edge" + help);
  const std::string coarse = error_of("--edge 30");
  EXPECT_EQ(coarse.rfind("bregma: --edge 30.00: gives ", 0), 0U) << coarse;
  EXPECT_NE(
      coarse.find(" tetrahedra in the brain of ball; 10,000 to 100,000 are made, by edges of about 5.5 to 11.9 mm"),
      std::string::npos)
      << coarse;
  EXPECT_EQ(run_bregma(folder_, "case mesh nowhere").err,
            "  0 %  case\nbregma: nowhere: is not a folder; a case is a folder with case.toml\n");
  EXPECT_EQ(error_of("--out none/t.vtu").substr(0, 60),
            std::string("bregma: none/t.vtu: cannot be written: No such file or directory").substr(0, 60));
}

} // namespace
