// `bregma register surface | cloud | curves` as programs.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "tests/unit/casefile/sample_case.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;
using Eigen::Vector3d;

constexpr unsigned kFilesSeed = 41;

const Eigen::Isometry3d kMoved =
    Eigen::Translation3d(40.0, -75.0, 120.0) * Eigen::AngleAxisd(2.3, Vector3d(0.3, -0.8, 0.5).normalized());

std::string table_of(const std::vector<Vector3d> &points) {
  std::ostringstream out;
  out.precision(12);
  for (const Vector3d &p : points) {
    out << p.x() << ',' << p.y() << ',' << p.z() << '\n';
  }
  return out.str();
}

std::string freesurfer_of(const bregma::surface::TriangleMesh &mesh) {
  std::ostringstream out;
  out << "#!ascii\n" << mesh.vertices_mm.size() << ' ' << mesh.triangles.size() << '\n';
  for (const Vector3d &v : mesh.vertices_mm) {
    out << v.transpose() << " 0\n";
  }
  for (const auto &t : mesh.triangles) {
    out << t.transpose() << " 0\n";
  }
  return out.str();
}

// Largest distance between points of a head under a printed matrix and under the true one.
double worst_mm(const nlohmann::json &matrix, const Eigen::Isometry3d &truth) {
  Eigen::Matrix4d T;
  for (Eigen::Index i = 0; i < 4; ++i) {
    for (Eigen::Index j = 0; j < 4; ++j) {
      T(i, j) = matrix[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)].get<double>();
    }
  }
  double worst = 0.0;
  for (const Vector3d &p : {Vector3d(0, 0, 0), Vector3d(100, 0, 0), Vector3d(0, 100, 0), Vector3d(0, 0, 100)}) {
    const Vector3d in_target = truth * p;
    worst = std::max(worst, (T.topLeftCorner<3, 3>() * p + T.topRightCorner<3, 1>() - in_target).norm());
  }
  return worst;
}

TEST(RegisterSurface, ABallIsNeverFoundAndNothingIsWritten) {
  const TemporaryFolder folder;
  const auto ball = bregma::tests::sphere({0, 0, 0}, 90, 4);
  folder.write("ball.asc", freesurfer_of(ball));
  std::vector<Vector3d> samples(ball.vertices_mm.begin(), ball.vertices_mm.begin() + 150);
  folder.write("trace.csv", table_of(samples));
  auto run = run_bregma(folder, "register surface trace.csv ball.asc --tfm no.tfm");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.err.rfind("bregma: ambiguous: ", 0), 0U) << run.err;
  EXPECT_EQ(run.out.find("T_target_source"), std::string::npos) << "a pose that is not known is not shown";
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "no.tfm"));
  run = run_bregma(folder, "register surface trace.csv ball.asc --json");
  EXPECT_EQ(run.exit_code, 1);
  const auto json = run.json();
  EXPECT_EQ(json["verdict"], "ambiguous");
  EXPECT_EQ(json["accepted"], false);
  for (const char *key : {"T_target_source", "T_source_target", "covariance", "targets"}) {
    EXPECT_TRUE(json.contains(key) && json[key].is_null()) << key;
  }
  ASSERT_FALSE(json["hypotheses"].empty());
  for (const auto &pose : json["hypotheses"]) {
    EXPECT_TRUE(pose["T_target_source"].is_null()) << "nor are those that were compared";
  }
}

TEST(RegisterSurface, WrongInputIsRefusedInWords) {
  const TemporaryFolder folder;
  folder.write("ball.asc", freesurfer_of(bregma::tests::sphere({0, 0, 0}, 90, 2)));
  folder.write("metres.asc", freesurfer_of(bregma::tests::sphere({0, 0, 0}, 0.09, 2)));
  folder.write("few.csv", "0,0,90\n90,0,0\n0,90,0\n");
  auto run = run_bregma(folder, "register surface few.csv ball.asc");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.err.rfind("bregma: refused: ", 0), 0U) << run.err;
  run = run_bregma(folder, "register surface few.csv metres.asc");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err,
            "bregma: metres.asc: the surface is 0.18 mm wide, at least 40 mm is taken: if the file is in metres, "
            "say --target-units m\n");
  folder.write("affine.tfm", "#Insight Transform File V1.0\nTransform: AffineTransform_double_3_3\n"
                             "Parameters: 2 0 0 0 1 0 0 0 1 0 0 0\nFixedParameters: 0 0 0\n");
  run = run_bregma(folder, "register surface few.csv ball.asc --start affine.tfm");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err,
            "bregma: affine.tfm: the transform is not rigid: it scales, shears or mirrors (determinant 0.5)\n");
}

TEST(RegisterSurface, ColinIsFoundFromAnywhereAndRefinedFromAStart) {
  BREGMA_SHARED_DATA(skin, "meshes/colin27/colin27_outer_skin_surface.asc");
  const TemporaryFolder folder;
  std::ifstream in(skin);
  std::string line;
  std::getline(in, line);
  std::size_t vertices = 0;
  std::size_t triangles = 0;
  in >> vertices >> triangles;
  std::mt19937 random(kFilesSeed);
  std::normal_distribution<double> noise(0.0, 0.5);
  std::vector<Vector3d> samples;
  for (std::size_t i = 0; i < vertices; ++i) {
    Vector3d p;
    double flag = 0.0;
    in >> p.x() >> p.y() >> p.z() >> flag;
    // Face, both sides and back determine all directions; the face of this smoothed skin alone does not.
    if (p.z() > -90.0 && i % 16 == 0) {
      samples.push_back(kMoved.inverse() * p + Vector3d(noise(random), noise(random), noise(random)));
    }
  }
  ASSERT_GT(samples.size(), 150U);
  folder.write("trace.csv", table_of(samples));
  folder.write("lesion.csv", "Lesion,10,20,30\n");
  const std::string files =
      "register surface trace.csv '" + skin.string() + "' --sigma-mm 0.7 --targets lesion.csv --json ";
  auto run = run_bregma(folder, files + "--tfm found.tfm");
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out << "seed " << kFilesSeed;
  auto json = run.json();
  EXPECT_EQ(json["verdict"], "found");
  EXPECT_LT(worst_mm(json["T_target_source"], kMoved), 2.0) << "seed " << kFilesSeed;
  EXPECT_LT(json["targets"][0]["tre_rms_mm"].get<double>(), 2.0);
  ASSERT_EQ(json["residuals_mm"].size(), samples.size());
  for (const auto &residual : json["residuals_mm"]) {
    EXPECT_LT(std::abs(residual.get<double>()), 4.0); // noise: 0.5 mm
  }
  EXPECT_NE(json["notes"].dump().find("does not say its space: taken as RAS"), std::string::npos);

  run = run_bregma(folder, files + "--start found.tfm");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  json = run.json();
  EXPECT_EQ(json["method"], "local");
  EXPECT_LT(worst_mm(json["T_target_source"], kMoved), 2.0);
}

std::vector<Vector3d> cloud_of(int count) {
  std::mt19937 random(kFilesSeed);
  std::uniform_real_distribution<double> uniform(-80.0, 80.0);
  std::vector<Vector3d> out;
  for (int i = 0; i < count; ++i) {
    out.emplace_back(uniform(random), uniform(random), uniform(random));
  }
  return out;
}

TEST(RegisterCloud, APhantomIsFoundAndItsMarkersArePaired) {
  const TemporaryFolder folder;
  const std::vector<Vector3d> source = cloud_of(60);
  std::vector<Vector3d> target;
  for (auto point = source.rbegin(); point != source.rend(); ++point) { // in reverse order
    target.push_back(kMoved * *point);
  }
  folder.write("ct.csv", table_of(source));
  folder.write("mr.csv", table_of(target));
  folder.write("lesion.csv", table_of({kMoved * Vector3d(5.0, 10.0, -20.0)}));
  const auto run = run_bregma(folder, "register cloud ct.csv mr.csv --correspondences pairs.csv --tfm a.tfm "
                                      "--targets lesion.csv --json");
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out << "seed " << kFilesSeed;
  EXPECT_LT(worst_mm(run.json()["T_target_source"], kMoved), 0.5) << "seed " << kFilesSeed;
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "a.tfm"));
  EXPECT_EQ(run.json()["covariance"].size(), 6U);
  EXPECT_GT(run.json()["targets"][0]["tre_rms_mm"], 0.0);
  EXPECT_LT(run.json()["targets"][0]["tre_rms_mm"], 0.5);
  const std::string pairs = bregma::tests::read_file(folder.path() / "pairs.csv");
  EXPECT_NE(pairs.find("\n1,60,"), std::string::npos) << pairs;
  EXPECT_NE(pairs.find("\n60,1,"), std::string::npos) << pairs;
}

TEST(RegisterCloud, ACubeIsAmbiguousAndThreePointsAreTooFew) {
  const TemporaryFolder folder;
  std::vector<Vector3d> cube;
  for (int corner = 0; corner < 8; ++corner) {
    cube.emplace_back((corner & 1) * 100.0, (corner & 2) * 50.0, (corner & 4) * 25.0);
  }
  folder.write("cube.csv", table_of(cube));
  auto run = run_bregma(folder, "register cloud cube.csv cube.csv");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.err.rfind("bregma: ambiguous: a pose that is turned by ", 0), 0U) << run.err;
  folder.write("three.csv", "0,0,0\n50,0,0\n0,50,0\n");
  run = run_bregma(folder, "register cloud three.csv cube.csv --json");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.json()["verdict"], "refused");
  EXPECT_TRUE(run.json()["T_target_source"].is_null() && run.json()["covariance"].is_null());
  run = run_bregma(folder, "register cloud cube.csv cube.csv --affine --scale");
  EXPECT_EQ(run.exit_code, 2);
}

// A blurred ball at the centre, as a MetaImage with LPS axes.
std::string ball_image(const Vector3d &centre_lps) {
  constexpr int kSize = 24;
  std::ostringstream out;
  out << "ObjectType = Image\nNDims = 3\nDimSize = 24 24 24\nElementSpacing = 4 4 4\nOffset = 0 0 0\n"
         "ElementType = MET_FLOAT\nElementDataFile = LOCAL\n";
  for (int i = 0; i < kSize * kSize * kSize; ++i) {
    const Eigen::Vector3i voxel(i % kSize, i / kSize % kSize, i / kSize / kSize);
    const Vector3d at = 4.0 * voxel.cast<double>();
    const auto value = static_cast<float>(100.0 * std::exp(-(at - centre_lps).squaredNorm() / 800.0));
    out.write(reinterpret_cast<const char *>(&value), sizeof value);
  }
  return out.str();
}

TEST(RegisterCurves, ImagesBecomeAlikeAndTheWarpedOneIsWritten) {
  const TemporaryFolder folder;
  // The source is the target moved by 8 mm to the left: minus x in RAS, plus x in LPS.
  folder.write("target.mha", ball_image({46, 46, 46}));
  folder.write("source.mha", ball_image({54, 46, 46}));
  folder.write("target.csv", "A,-10,-10,-0\nA,-80,-10,5\nA,-80,-80,0\nB,-20,-20,80\nB,-50,-60,85\nB,-80,-80,80\n");
  folder.write("source.csv", "A,-18,-10,-0\nA,-88,-10,5\nA,-88,-80,0\nB,-28,-20,80\nB,-58,-60,85\nB,-88,-80,80\n");
  folder.write("pt.csv", "P,-46,-46,46\nQ,-10,-80,40\n");
  folder.write("ps.csv", "P,-54,-46,46\nQ,-18,-80,40\n");
  const auto run =
      run_bregma(folder, "register curves source.csv target.csv --source-points ps.csv --target-points pt.csv "
                         "--source-image source.mha --target-image target.mha --warped out.nii.gz --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = run.json();
  EXPECT_EQ(json["landmarks"], 2);
  EXPECT_LT(json["landmarks_held_out_worst_mm"].get<double>(), 1e-6) << "a shift is reproduced";
  EXPECT_LT(json["curves"][0]["held_out_rms_mm"].get<double>(), 1e-6);
  EXPECT_LT(json["image"]["rmse_after"].get<double>(), 0.2 * json["image"]["rmse_before"].get<double>());
  EXPECT_GT(json["image"]["mutual_information_after"].get<double>(),
            json["image"]["mutual_information_before"].get<double>());
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "out.nii.gz"));
}

TEST(RegisterCurves, WhatIsNoPairIsNamed) {
  const TemporaryFolder folder;
  folder.write("a.csv", "A,0,0,0\nA,50,0,0\nB,0,0,50\nB,0,50,60\n");
  folder.write("b.csv", "A,0,0,0\nA,50,0,0\nC,0,0,50\nC,0,50,60\n");
  folder.write("flat.csv", "A,5,0,0\nA,5,50,0\nB,5,0,10\nB,5,0,50\n");
  EXPECT_EQ(run_bregma(folder, "register curves a.csv b.csv").err, "bregma: b.csv: has no curve \"B\"\n");
  EXPECT_EQ(run_bregma(folder, "register curves a.csv a.csv --source-points a.csv").err,
            "bregma: --source-points and --target-points go together\n");
  EXPECT_EQ(run_bregma(folder, "register curves a.csv a.csv --warped out.nii").err,
            "bregma: --source-image and --target-image go together, and --warped needs them\n");
  const auto flat = run_bregma(folder, "register curves flat.csv flat.csv");
  EXPECT_EQ(flat.exit_code, 1);
  EXPECT_EQ(flat.err.rfind("bregma: refused: ", 0), 0U) << flat.err;
}

// A spline fits anything, so it is tried what else would fit the marks.
TEST(RegisterCurves, SidesThatDoNotBelongTogetherAreRefused) {
  const TemporaryFolder folder;
  using Curve = std::vector<Vector3d>;
  const std::vector<std::pair<std::string, Curve>> marked{{"A", {{0, 0, 0}, {50, 10, 0}, {60, 50, 20}}},
                                                          {"B", {{-40, 0, 50}, {-60, 30, 60}, {-50, 70, 90}}},
                                                          {"C", {{10, -80, 20}, {20, -60, 60}, {0, -20, 90}}}};
  const auto table = [&](const Vector3d &scales, const std::vector<std::size_t> &order, bool reversed) {
    std::string out = "curve,x,y,z\n";
    for (std::size_t i = 0; i < marked.size(); ++i) {
      Curve curve = marked[order[i]].second;
      if (reversed && i == 1) {
        std::reverse(curve.begin(), curve.end());
      }
      for (const Vector3d &mark : curve) {
        const Vector3d p = kMoved * Vector3d(scales.cwiseProduct(mark));
        out += marked[i].first + "," + std::to_string(p.x()) + "," + std::to_string(p.y()) + "," +
               std::to_string(p.z()) + "\n";
      }
    }
    return out;
  };
  folder.write("a.csv", table({1, 1, 1}, {0, 1, 2}, false));
  for (const auto &[content, said] :
       {std::pair(table({1, 1, 1}, {0, 1, 2}, false), ""),
        {table({1.1, 1.05, 0.95}, {0, 1, 2}, false), ""}, // another head
        {table({-1, 1, 1}, {0, 1, 2}, false), "one side is the mirror image of the other"},
        {table({0.1, 0.1, 0.1}, {0, 1, 2}, false), "are both in mm?"},
        {table({1, 1, 1}, {1, 0, 2}, false), "the curves \"A\" and \"B\" are exchanged"},
        {table({1, 1, 1}, {0, 1, 2}, true), "curve \"B\" is marked in the other direction"}}) {
    folder.write("b.csv", content);
    const auto run = run_bregma(folder, "register curves a.csv b.csv --json");
    EXPECT_EQ(run.exit_code, *said == '\0' ? 0 : 1) << run.out;
    EXPECT_TRUE(*said == '\0' || run.json()["reason"].get<std::string>().find(said) != std::string::npos) << run.out;
  }
}

// A slice: the spline is two-dimensional, and options that it does not support are reported.
TEST(RegisterCurves, MarksOnASliceAreRegisteredInThePlane) {
  const TemporaryFolder folder;
  folder.write("target.csv", "A,0,0,7\nA,50,0,7\nA,60,40,7\nB,0,10,7\nB,-20,50,7\nB,0,80,7\n");
  folder.write("source.csv", "A,3,-2,9\nA,53,-2,9\nA,63,38,9\nB,3,8,9\nB,-17,48,9\nB,3,78,9\n");
  folder.write("pt.csv", "P,20,30,7\nQ,35,60,7\n");
  folder.write("ps.csv", "P,23,28,9\nQ,38,58,9\n");
  const auto run =
      run_bregma(folder, "register curves source.csv target.csv --source-points ps.csv --target-points pt.csv --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = run.json();
  EXPECT_EQ(json["dimensions"], 2);
  EXPECT_EQ(json["kernel"], "r2logr");
  EXPECT_LT(json["landmarks_held_out_worst_mm"].get<double>(), 1e-6) << "a shift is reproduced";
  EXPECT_LT(json["curves"][1]["held_out_rms_mm"].get<double>(), 1e-6);
  folder.write("image.mha", ball_image({46, 46, 46}));
  EXPECT_EQ(
      run_bregma(folder, "register curves source.csv target.csv --source-image image.mha --target-image image.mha").err,
      "bregma: all points of a side have the same z: they define a warp in the plane, but not of a 3-D image\n");
  // A landmark off the slice makes the registration three-dimensional.
  folder.write("off.csv", "P,20,30,7.5\nQ,35,60,7\n");
  const auto space =
      run_bregma(folder, "register curves source.csv target.csv --source-points ps.csv --target-points off.csv --json");
  EXPECT_EQ(space.exit_code, 0) << space.err;
  EXPECT_EQ(space.json()["dimensions"], 3);
}

} // namespace
