#include <gtest/gtest.h>

#include "casefile/case.hpp"
#include "casefile/markups.hpp"
#include "casefile/mesh_file.hpp"
#include "idl/names.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace {

using namespace bregma::casefile;
using bregma::test::TemporaryFolder;
using bregma::tests::sample_case;

class CaseOnDisk : public testing::Test {
protected:
  void SetUp() override {
    folder_.write("image.nii.gz", "not read here");
    case_ = sample_case(folder_.path());
    const auto saved = save_case(case_);
    ASSERT_TRUE(saved) << saved.error().message;
    toml_ = bregma::tests::read_file(folder_.path() / "case.toml");
  }

  // The message after "<folder>/" for the case with one part of case.toml replaced.
  std::string error_with(const std::string &old_text, const std::string &new_text) {
    std::string changed = toml_;
    const auto at = changed.find(old_text);
    EXPECT_NE(at, std::string::npos) << old_text << "\n" << toml_;
    changed.replace(at, old_text.size(), new_text);
    folder_.write("case.toml", changed);
    return load_error();
  }
  // The message for the sample with one change in memory, after saving and loading.
  template <class Change> std::string error_after(Change change) {
    Case changed = sample_case(folder_.path());
    change(changed);
    const auto saved = save_case(changed);
    EXPECT_TRUE(saved) << saved.error().message;
    return load_error();
  }
  std::string load_error() {
    const auto loaded = load_case(folder_.path());
    const std::string message = loaded ? "no error" : loaded.error().message;
    const std::string prefix = folder_.path().string() + "/";
    return message.rfind(prefix, 0) == 0 ? message.substr(prefix.size()) : message;
  }
  int line_of(const std::string &text) const {
    const auto at = toml_.find(text);
    return 1 + static_cast<int>(std::count(toml_.begin(), toml_.begin() + static_cast<std::ptrdiff_t>(at), '\n'));
  }
  std::string at(const std::string &text) const { return "case.toml:" + std::to_string(line_of(text)) + ": "; }

  TemporaryFolder folder_;
  Case case_;
  std::string toml_;
};

TEST_F(CaseOnDisk, RoundTrips) {
  const auto loaded = load_case(folder_.path());
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->id, "sample");
  EXPECT_EQ(loaded->image, case_.image);
  ASSERT_EQ(loaded->scalp.mesh.vertices_mm.size(), case_.scalp.mesh.vertices_mm.size());
  for (std::size_t i = 0; i < case_.scalp.mesh.vertices_mm.size(); ++i) {
    EXPECT_LT((loaded->scalp.mesh.vertices_mm[i] - case_.scalp.mesh.vertices_mm[i]).norm(), 1e-4) << "PLY keeps floats";
  }
  EXPECT_EQ(loaded->scalp.mesh.triangles, case_.scalp.mesh.triangles);
  ASSERT_EQ(loaded->structures.size(), 2U);
  EXPECT_EQ(loaded->structures[1].name, "Precentral R");
  ASSERT_EQ(loaded->fiducials.size(), 4U);
  EXPECT_EQ(loaded->fiducial("F3")->position_mm, case_.fiducials[2].position_mm);
  EXPECT_EQ(loaded->landmark("Nasion")->position_mm, case_.landmarks[0].position_mm);
  EXPECT_EQ(loaded->trajectory("Biopsy")->entry_mm, case_.trajectories[0].entry_mm);
  EXPECT_EQ(loaded->targets[0].name, "Lesion");
  ASSERT_EQ(loaded->brain_landmarks.size(), 1U);
  EXPECT_EQ(loaded->brain_landmarks[0].position_mm, case_.brain_landmarks[0].position_mm);
  EXPECT_EQ(loaded->reference()->name, "Reference");
  ASSERT_NE(loaded->tool("Probe"), nullptr);
  EXPECT_EQ(loaded->tool("Probe")->role, ToolRole::kProbe);
  EXPECT_EQ(loaded->tool("Probe")->markers_mm, case_.tools[2].markers_mm);
  EXPECT_EQ(loaded->tool("Probe")->nominal_tip_mm, case_.tools[2].nominal_tip_mm);
  EXPECT_EQ(loaded->limits.max_check_mm, 2.5);
  EXPECT_EQ(loaded->tool("Nobody"), nullptr);
}

TEST_F(CaseOnDisk, ErrorsInCaseTomlAreReportedWithLineKeyAndValue) {
  EXPECT_EQ(error_with("max_check_mm = 2.5", "max_check_mm = -3"),
            at("max_check_mm") + "limits.max_check_mm = -3: must be between 0.01 and 20 mm");
  EXPECT_EQ(error_with("max_check_mm = 2.5", "max_chek_mm = 2.5"),
            at("max_check_mm") + "limits.max_chek_mm = 2.5: unknown key; did you mean limits.max_check_mm?");
  EXPECT_EQ(error_with("role = \"probe\"", "role = \"needle\""),
            at("role = \"probe\"") +
                "tools[2].role = \"needle\": must be one of \"reference\", \"pointer\", \"probe\"");
  EXPECT_EQ(error_with("id = \"sample\"\n", ""), "case.toml:1: id: is missing");
  EXPECT_EQ(error_with("id = \"sample\"", "id = \"J. Smith\""),
            "case.toml:1: id = \"J. Smith\": must be 1 to 31 bytes without blanks, slashes and quotes");
  EXPECT_EQ(error_with("image.nii.gz", "gone.nii.gz"),
            "case.toml:2: image = \"gone.nii.gz\": no such file: " + (folder_.path() / "gone.nii.gz").string());
  EXPECT_EQ(error_with("name = \"Stylus\"", "name = \"Reference\""),
            at("[[tools]]") + "tools: tool 2 has the name \"Reference\", which is already taken");
  EXPECT_EQ(error_with("role = \"pointer\"", "role = \"reference\""),
            at("role = \"pointer\"") +
                "tools[1].role = \"reference\": there is already a reference, \"Reference\"; a case has exactly one");
  EXPECT_EQ(error_with("role = \"reference\"", "role = \"pointer\""),
            at("[[tools]]") + "tools: none of the tools has the role \"reference\"; a case has exactly one");
  const std::string syntax = error_with("[limits]", "[limits");
  EXPECT_EQ(syntax.rfind(at("[limits]"), 0), 0U) << syntax;
}

TEST_F(CaseOnDisk, ABrainMayBeMissingAndWhatNeedsItIsThenRefused) {
  const auto without = [this](bool landmarks, bool craniotomy) {
    return error_after([&](Case &c) {
      c.brain = {};
      if (!landmarks) {
        c.brain_landmarks.clear();
      }
      if (craniotomy) {
        c.craniotomy = CraniotomyPlan{.trajectory = "Biopsy", .radius_mm = std::nullopt};
      }
    });
  };
  EXPECT_EQ(without(false, false), "no error");
  EXPECT_EQ(bregma::tests::read_file(folder_.path() / "case.toml").find("brain"), std::string::npos);
  EXPECT_NE(without(true, false).find("the tissue model follows them, and the case has no brain (surfaces.brain)"),
            std::string::npos);
  EXPECT_NE(without(false, true).find("craniotomy: is for the tissue model, and the case has no brain"),
            std::string::npos)
      << without(false, true);
}

TEST_F(CaseOnDisk, WrongFilesAreReportedWithTheLineThatRefersToThem) {
  EXPECT_EQ(error_with("surfaces/brain.ply", "surfaces/none.ply"),
            at("brain = ") + "surfaces.brain = \"surfaces/none.ply\": " +
                (folder_.path() / "surfaces/none.ply").string() + ": No such file or directory");
  folder_.write("case.toml", toml_);
  folder_.write("landmarks.mrk.json", "{\"markups\": 3}");
  EXPECT_EQ(load_error(), at("landmarks = ") + "landmarks = \"landmarks.mrk.json\": " +
                              (folder_.path() / "landmarks.mrk.json").string() +
                              ": is not a Slicer markups file: it has no list \"markups\"");
}

TEST_F(CaseOnDisk, AnImpossiblePlanIsRefused) {
  const std::string fiducials = at("fiducials = ") + "fiducials = \"fiducials.mrk.json\": ";
  EXPECT_EQ(error_after([](Case &c) { c.fiducials[1].name = "F1"; }),
            fiducials + "control point 2 has the name \"F1\", which is already taken");
  EXPECT_EQ(error_after([](Case &c) { c.fiducials[1].name = " "; }), fiducials + "control point 2 has no name");
  EXPECT_EQ(error_after([](Case &c) { c.fiducials[0].name = std::string(32, 'x'); }),
            fiducials + "control point 1 name \"" + std::string(32, 'x') + "\" has 32 bytes, at most 31 are allowed");
  EXPECT_EQ(error_after([](Case &c) { c.fiducials.resize(2); }),
            fiducials + "holds 2 points; a registration needs 3, and at most 64 are allowed");
  EXPECT_EQ(error_after([](Case &c) {
              c.fiducials[2].position_mm = {0, 200, 0};
            }),
            fiducials + "\"F3\" lies 110.0 mm from the scalp: is it in the coordinates of this image (RAS or LPS)?");
  EXPECT_EQ(error_after([](Case &c) { c.landmarks[0].name = "F1"; }),
            at("landmarks = ") + "landmarks = \"landmarks.mrk.json\": \"F1\" is also a fiducial: a check must be "
                                 "independent");
  EXPECT_EQ(error_after([](Case &c) {
              c.targets[0].position_mm = {0, 0, -120};
            }),
            at("targets = ") + "targets = \"targets.mrk.json\": \"Lesion\" lies outside the head");
  const std::string in_brain = at("brain_landmarks = ") + "brain_landmarks = \"brain_landmarks.mrk.json\": ";
  EXPECT_EQ(error_after([](Case &c) { c.brain_landmarks[0].name = "Lesion"; }),
            in_brain + "\"Lesion\" is also a target");
  EXPECT_EQ(error_after([](Case &c) { c.brain_landmarks[0].position_mm.z() = -80; }),
            in_brain + "\"Anterior commissure\" lies outside the brain");
  EXPECT_EQ(error_after([](Case &c) {
              for (int i = 0; i < 16; ++i) {
                c.brain_landmarks.push_back({"L" + std::to_string(i), {0, 0, 0}});
              }
            }),
            in_brain + "holds 17 points, at most 16 are allowed");
  const std::string trajectories = at("trajectories = ") + "trajectories = \"trajectories.mrk.json\": ";
  EXPECT_EQ(error_after([](Case &c) { c.trajectories[0].target_mm.x() += 3.0; }),
            trajectories + "\"Biopsy\" ends 3.0 mm from the nearest target, \"Lesion\"");
  EXPECT_EQ(error_after([](Case &c) { c.trajectories[0].entry_mm = c.trajectories[0].target_mm; }),
            trajectories + "\"Biopsy\" is 0.00 mm long");
}

TEST_F(CaseOnDisk, ToolsWithoutADefinedPoseAreRefused) {
  const std::string markers = "case.toml:" + std::to_string(line_of("name = \"Stylus\"") + 2) + ": tools[1].markers_mm";
  const auto error = [&](auto change) { return error_after([&](Case &c) { change(c.tools[1]); }); };
  const auto two = error([](ToolModel &t) { t.markers_mm.resize(2); });
  EXPECT_NE(two.find("holds 2 markers; a pose needs 3, and at most 32 are allowed"), std::string::npos) << two;
  EXPECT_EQ(error([](ToolModel &t) { t.markers_mm.clear(); }), "no error") << "of a tracker without markers";
  const auto line = error([](ToolModel &t) { t.markers_mm = {{0, 0, 0}, {50, 0, 0}, {100, 1, 0}}; });
  EXPECT_EQ(line.rfind("case.toml:", 0), 0U);
  EXPECT_NE(line.find("tools[1].markers_mm"), std::string::npos) << line;
  EXPECT_NE(line.find("the markers lie on a line (within 0.5 mm): the turn about it cannot be measured"),
            std::string::npos)
      << line;
  const auto same = error([](ToolModel &t) { t.markers_mm[3] = t.markers_mm[0]; });
  EXPECT_NE(same.find("markers 1 and 4 are the same"), std::string::npos) << same;
  const auto zero = error([](ToolModel &t) { t.normal.setZero(); });
  EXPECT_NE(zero.find("tools[1].normal = [ 0.0, 0.0, 0.0 ]: must be a direction, not zero"), std::string::npos) << zero;
}

TEST_F(CaseOnDisk, SurfacesMustBeClosedAndOutward) {
  const auto hole = error_after([](Case &c) { c.structures[0].mesh.triangles.pop_back(); });
  EXPECT_NE(
      hole.find("structures[0].file = \"surfaces/precentral_l.ply\": the surface is not closed: 3 edges belong to "
                "one triangle only"),
      std::string::npos)
      << hole;
  const auto inside_out = error_after([](Case &c) {
    for (Eigen::Vector3i &t : c.scalp.mesh.triangles) {
      std::swap(t[0], t[1]);
    }
  });
  EXPECT_NE(inside_out.find("surfaces.scalp = \"surfaces/scalp.ply\": the triangles of the surface face inwards"),
            std::string::npos)
      << inside_out;
  const auto twisted =
      error_after([](Case &c) { std::swap(c.brain.mesh.triangles[0][0], c.brain.mesh.triangles[0][1]); });
  EXPECT_NE(twisted.find("surfaces.brain = \"surfaces/brain.ply\": the surface is not oriented"), std::string::npos)
      << twisted;
}

TEST_F(CaseOnDisk, DirectionsAreMadeUnitVectors) {
  case_.tools[1].normal = {0, 3, 4};
  ASSERT_TRUE(save_case(case_));
  const auto loaded = load_case(folder_.path());
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_TRUE(loaded->tools[1].normal.isApprox(Eigen::Vector3d(0, 0.6, 0.8), 1e-12));
}

TEST_F(CaseOnDisk, TablesOfTheTissueModelRoundTrip) {
  EXPECT_EQ(toml_.find("[craniotomy]"), std::string::npos) << "a case need not have them";
  EXPECT_EQ(toml_.find("[tissue]"), std::string::npos);
  case_.craniotomy = {.trajectory = "Biopsy", .radius_mm = 17.5};
  case_.tissue = {.material = "miller-chinzei",
                  .young_Pa = 3100.0,
                  .poisson = std::nullopt,
                  .density_kg_m3 = 1040.0,
                  .ogden_alpha = -3.0};
  ASSERT_TRUE(save_case(case_));
  auto loaded = load_case(folder_.path());
  ASSERT_TRUE(loaded) << loaded.error().message;
  ASSERT_TRUE(loaded->craniotomy && loaded->tissue);
  EXPECT_EQ(loaded->craniotomy->trajectory, "Biopsy");
  EXPECT_EQ(loaded->craniotomy->radius_mm, 17.5);
  EXPECT_EQ(loaded->tissue->material, "miller-chinzei");
  EXPECT_EQ(loaded->tissue->young_Pa, 3100.0);
  EXPECT_EQ(loaded->tissue->poisson, std::nullopt);
  EXPECT_EQ(loaded->tissue->density_kg_m3, 1040.0);
  EXPECT_EQ(loaded->tissue->ogden_alpha, -3.0);

  case_.craniotomy = {.trajectory = "", .centre_mm = {10.0, 20.5, 70.0}, .radius_mm = std::nullopt};
  case_.tissue.reset();
  ASSERT_TRUE(save_case(case_));
  loaded = load_case(folder_.path());
  ASSERT_TRUE(loaded) << loaded.error().message;
  ASSERT_TRUE(loaded->craniotomy);
  EXPECT_EQ(loaded->craniotomy->trajectory, "");
  EXPECT_EQ(loaded->craniotomy->centre_mm, Eigen::Vector3d(10.0, 20.5, 70.0));
  EXPECT_EQ(loaded->craniotomy->radius_mm, std::nullopt);
  EXPECT_FALSE(loaded->tissue);
}

TEST_F(CaseOnDisk, ErrorsInTheTissueTablesAreReported) {
  const int end = static_cast<int>(std::count(toml_.begin(), toml_.end(), '\n'));
  // The message after "case.toml:", with the line relative to the table's first line.
  const auto error_of = [&](const std::string &table) {
    folder_.write("case.toml", toml_ + table);
    const std::string message = load_error();
    const std::string file = "case.toml:";
    EXPECT_EQ(message.rfind(file, 0), 0U) << message;
    const std::string rest = message.substr(std::min(message.size(), file.size()));
    return std::to_string(std::atoi(rest.c_str()) - end) + rest.substr(std::min(rest.size(), rest.find(':')));
  };
  EXPECT_EQ(error_of("[craniotomy]\nradius_mm = 15\n"), "1: craniotomy.centre_mm: give either centre_mm or trajectory");
  EXPECT_EQ(error_of("[craniotomy]\ntrajectory = \"Biopsy\"\ncentre_mm = [0, 0, 75]\n"),
            "3: craniotomy.centre_mm = [ 0, 0, 75 ]: give either centre_mm or trajectory");
  EXPECT_EQ(error_of("[craniotomy]\ntrajectory = \"Bipsy\"\n"),
            "2: craniotomy.trajectory = \"Bipsy\": no such trajectory; there are \"Biopsy\"");
  EXPECT_EQ(error_of("[craniotomy]\ntrajectory = \"\"\n"),
            "2: craniotomy.trajectory = \"\": must be the name of a trajectory");
  EXPECT_EQ(error_of("[craniotomy]\ncentre_mm = [0, 0, 110]\n"),
            "2: craniotomy.centre_mm = [ 0, 0, 110 ]: lies more than 30 mm from the brain's surface: is it in the "
            "coordinates of this image (RAS)?");
  EXPECT_EQ(error_of("[craniotomy]\ncentre_mm = [0, 75]\n"),
            "2: craniotomy.centre_mm = [ 0, 75 ]: must be three finite numbers, [x, y, z]");
  EXPECT_EQ(error_of("[craniotomy]\ntrajectory = \"Biopsy\"\nradius_mm = -1\n"),
            "3: craniotomy.radius_mm = -1: must be between 0 and 100 mm");
  EXPECT_EQ(error_of("[craniotomy]\ntrajectory = \"Biopsy\"\nradus_mm = 1\n"),
            "3: craniotomy.radus_mm = 1: unknown key; did you mean craniotomy.radius_mm?");
  EXPECT_EQ(error_of("[tissue]\nyoung_Pa = 2100\n"), "1: tissue.material: is missing");
  EXPECT_EQ(error_of("[tissue]\nmaterial = \"jelly\"\n"),
            "2: tissue.material = \"jelly\": must be one of \"thesis\", \"miller-chinzei\", \"linear\"");
  EXPECT_EQ(error_of("[tissue]\nmaterial = \"thesis\"\npoisson = 0.5\n"),
            "3: tissue.poisson = 0.5: must be between 0 and 0.499");
  EXPECT_EQ(error_of("[tissue]\nmaterial = \"thesis\"\nyoung_Pa = \"soft\"\n"),
            "3: tissue.young_Pa = \"soft\": must be a number, in Pa");
  EXPECT_EQ(error_of("[tissue]\nmaterial = \"thesis\"\nogden_alpha = 3.0\n"),
            "3: tissue.ogden_alpha = 3.0: the material \"thesis\" has no alpha");
  EXPECT_EQ(error_of("[tissue]\nmaterial = \"miller-chinzei\"\nogden_alpha = 0\n"),
            "3: tissue.ogden_alpha = 0: must not be 0");
}

TEST(Case, AFolderWithoutCaseTomlIsNamed) {
  TemporaryFolder folder;
  EXPECT_EQ(load_case(folder.path()).error().message,
            (folder.path() / "case.toml").string() + ": No such file or directory");
  EXPECT_EQ(load_case("/no/such").error().message, "/no/such: is not a folder; a case is a folder with case.toml");
}

// The limits of a case are those of the DDS messages.
TEST(Case, LimitsAreThoseOfTheWire) {
  using namespace bregma;
  EXPECT_EQ(wire::kNameLength, 31U);
  EXPECT_EQ(std::size(wire::TrackerFrame{}.tools), 12U);
  EXPECT_EQ(std::size(wire::FiducialReport{}.fiducials), 64U);
  EXPECT_EQ(std::size(wire::AccuracyState{}.targets), 32U);
  EXPECT_EQ(bregma_wire_MAX_BRAIN_LANDMARKS, 16);
}

TEST(MeshFile, DamagedFilesAreRefused) {
  TemporaryFolder folder;
  const auto file = folder.path() / "s.ply";
  ASSERT_TRUE(write_mesh(file, bregma::tests::sphere({0, 0, 0}, 10, 2)));
  const std::string whole = bregma::tests::read_file(file);
  const auto error_of = [&](const std::string &content) {
    const auto damaged = folder.write("d.ply", content);
    const auto mesh = read_mesh(damaged);
    return mesh ? "no error" : mesh.error().message.substr(damaged.string().size());
  };
  EXPECT_EQ(error_of("solid x"), ": is not a PLY file");
  EXPECT_EQ(error_of(whole.substr(0, 40)), ": the PLY header has no end");
  EXPECT_EQ(error_of("ply\nformat ascii 1.0\nend_header\n"), ": holds no vertices");
  EXPECT_EQ(error_of(whole.substr(0, whole.size() - 20)), ": ends or is damaged at face 126 of 128");
  EXPECT_EQ(error_of(whole.substr(0, whole.find("end_header") + 30)), ": ends or is damaged at vertex 1 of 66");
  EXPECT_EQ(
      error_of("ply\nformat binary_middle_endian 1.0\nend_header\n"),
      ": its format is \"binary_middle_endian\", only ascii, binary_little_endian and binary_big_endian are read");
  EXPECT_EQ(error_of("ply\nelement vertex many\n"), ": the header says \"element vertex many\"");
  const std::string ascii =
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float "
      "z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
  EXPECT_EQ(error_of(ascii + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 1\n"),
            ": face 0 has 2 corners, a face has three at least");
  const std::string square = ascii + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
  EXPECT_EQ(error_of(square + "3 0 1 1\n"), ": triangle 0 has a vertex twice");
  EXPECT_EQ(error_of(square + "3 0 1 4\n"), ": triangle 0 refers to a vertex that does not exist");
  EXPECT_EQ(error_of(square + "3 0 1 -1\n"), ": triangle 0 refers to a vertex that does not exist");
  EXPECT_EQ(error_of(square + "3 0 1 x\n"), ": ends or is damaged at face 0 of 1");
  EXPECT_EQ(error_of(ascii + "0 0 0\n1 0 nan\n1 1 0\n0 1 0\n3 0 1 2\n"), ": vertex 1 is not finite");
  EXPECT_EQ(error_of(square + "3 0 1 2\n"), "no error");
}

} // namespace
