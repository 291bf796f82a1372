// `bregma register scan` as a program: the whole from a text file of records.
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "drivers/sim/range/surface_under_beam.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::surface::TriangleMesh;
using bregma::test::TemporaryFolder;
using bregma::tests::kFullDisk;
using bregma::tests::kOutputLost;
using bregma::tests::run_bregma;
using Eigen::Vector3d;

constexpr unsigned kScanSeed = 7;
constexpr double kHeight_mm = 200.0;

// The head of the tests with features that no symmetric head has: brows, cheeks, a mouth, a chin.
TriangleMesh head_with_features() {
  TriangleMesh out = bregma::test::make_head(5);
  struct Bump {
    Vector3d direction;
    double height_mm, width;
  };
  const std::array<Bump, 7> bumps{{{{0.30, 0.9, 0.35}, 7.0, 0.16},
                                   {{-0.30, 0.9, 0.32}, 6.0, 0.14},
                                   {{0.28, 0.9, 0.08}, -8.0, 0.12},
                                   {{-0.28, 0.9, 0.10}, -8.0, 0.12},
                                   {{0.42, 0.8, -0.25}, 7.0, 0.15},
                                   {{0.0, 0.9, -0.42}, -6.0, 0.12},
                                   {{0.03, 0.8, -0.62}, 10.0, 0.14}}};
  for (Vector3d &v : out.vertices_mm) {
    const Vector3d direction = (v - bregma::test::kHeadCentre).normalized();
    for (const Bump &bump : bumps) {
      const double apart = (direction - bump.direction.normalized()).squaredNorm();
      v += bump.height_mm * std::exp(-0.5 * apart / (bump.width * bump.width)) * direction;
    }
  }
  return out;
}

std::string freesurfer_text(const TriangleMesh &mesh) {
  std::string out =
      "#!ascii\n" + std::to_string(mesh.vertices_mm.size()) + " " + std::to_string(mesh.triangles.size()) + "\n";
  std::array<char, 120> line{};
  for (const Vector3d &v : mesh.vertices_mm) {
    std::snprintf(line.data(), line.size(), "%.5f %.5f %.5f 0\n", v.x(), v.y(), v.z());
    out += line.data();
  }
  for (const auto &t : mesh.triangles) {
    std::snprintf(line.data(), line.size(), "%d %d %d 0\n", t[0], t[1], t[2]);
    out += line.data();
  }
  return out;
}

// A head that lies on its back before a robot, and the records of a raster over its face.
class ScanOfAHead : public testing::Test {
protected:
  ScanOfAHead() {
    const TriangleMesh head = head_with_features();
    folder_.write("head.asc", freesurfer_text(head));
    T_robot_image_ = Eigen::AngleAxisd(0.7, Vector3d::UnitZ()) * Eigen::AngleAxisd(0.5 * M_PI + 0.1, Vector3d::UnitX());
    TriangleMesh placed = head;
    double highest = -1e9;
    for (Vector3d &v : placed.vertices_mm) {
      v = T_robot_image_ * v;
      highest = std::max(highest, v.z());
    }
    const Vector3d up(400.0, -50.0, 85.0 - highest);
    T_robot_image_.pretranslate(up);
    for (Vector3d &v : placed.vertices_mm) {
      v += up;
    }
    const bregma::sim::SurfaceUnderBeam surface(placed);
    std::mt19937 rng(kScanSeed);
    std::normal_distribution<double> noise(0.0, 0.4);
    for (double y = -130.0; y <= 30.0; y += 5.0) {
      for (double x = 320.0; x <= 480.0; x += 5.0) {
        const auto top = surface.top(x, y);
        if (top && top->z_mm > 20.0 && top->normal.z() > 0.4) {
          rows_.push_back({x, y, kHeight_mm - top->z_mm + noise(rng)});
        }
      }
    }
  }

  // As readings of a curve, distance = 130 * reading^-1.1.
  [[nodiscard]] std::string records() const {
    std::string out;
    std::array<char, 120> line{};
    for (const Vector3d &row : rows_) {
      std::snprintf(line.data(), line.size(), "%.2f\t%.2f\t%.5f\n", row.x(), row.y(),
                    std::pow(row.z() / 130.0, -1.0 / 1.1));
      out += line.data();
    }
    return out;
  }

  // Distance of a deep target from its place under the registration of the document.
  [[nodiscard]] double target_error_mm(const nlohmann::json &document) const {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    for (Eigen::Index i = 0; i < 3; ++i) {
      for (Eigen::Index j = 0; j < 4; ++j) {
        T(i, j) = document["T_target_source"][static_cast<std::size_t>(i)][static_cast<std::size_t>(j)].get<double>();
      }
    }
    const Vector3d target(0.0, 10.0, 20.0);
    return (T * (T_robot_image_ * target) - target).norm();
  }

  TemporaryFolder folder_;
  Eigen::Isometry3d T_robot_image_;
  std::vector<Vector3d> rows_; // x, y, distance
};

const std::string kRaw = " --window 1 --every 1 --sensor-delay-ms 0";
const std::string kCurve = " --scale-mm 130 --exponent -1.1";

TEST_F(ScanOfAHead, IsRegisteredFromItsRecordsWithoutAStart) {
  ASSERT_GT(rows_.size(), 300U);
  folder_.write("scan.txt", records());
  folder_.write("lesion.csv", "Lesion,0,10,20\n");
  const auto run = run_bregma(folder_, "register scan scan.txt head.asc --targets lesion.csv --sigma-mm 0.6 --json "
                                       "--tfm found.tfm" +
                                           kRaw + kCurve);
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out << "seed " << kScanSeed;
  const auto json = run.json();
  EXPECT_EQ(json["verdict"], "found");
  EXPECT_LT(target_error_mm(json), 1.5) << "seed " << kScanSeed;
  EXPECT_EQ(json["scan"]["points"], rows_.size());
  EXPECT_EQ(json["scan"]["missing"], 0);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "found.tfm"));
  // A bias that the operator states is part of the predicted error.
  const auto biased = run_bregma(folder_, "register scan scan.txt head.asc --targets lesion.csv --sigma-mm 0.6 --json "
                                          "--bias-mm 5" +
                                              kRaw + kCurve)
                          .json();
  EXPECT_GT(biased["targets"][0]["tre_rms_mm"].get<double>(), 4.9);
  EXPECT_LT(json["targets"][0]["tre_rms_mm"].get<double>(), 2.0);
  // From a calibration's file.
  folder_.write("curve.json", R"({"accepted": true, "scale_mm": 130.0, "exponent": -1.1,
                                  "covariance": [[0.01, 0.0], [0.0, 1e-6]]})");
  const auto by_file =
      run_bregma(folder_, "register scan scan.txt head.asc --sigma-mm 0.6 --json --curve curve.json" + kRaw);
  ASSERT_EQ(by_file.exit_code, 0) << by_file.err;
  EXPECT_EQ(by_file.json()["T_target_source"], json["T_target_source"]);
  EXPECT_GT(by_file.json()["scan"]["bias_sigma_mm"].get<double>(), 0.3);
}

TEST_F(ScanOfAHead, MissingAndDamagedRowsAreCountedAndLeftOut) {
  std::string text = "X, Y, Reading\n";
  std::array<char, 120> line{};
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const double reading = std::pow(rows_[i].z() / 130.0, -1.0 / 1.1);
    std::snprintf(line.data(), line.size(), "%.2f,%.2f,", rows_[i].x(), rows_[i].y());
    text += line.data();
    if (i % 10 == 3) {
      text += i % 20 == 3 ? "NaN\n" : "\n";
    } else if (i % 40 == 7) {
      text += "1.\xC3\x28"
              "7\n"; // garbled
    } else {
      std::snprintf(line.data(), line.size(), "%.5f\n", reading);
      text += line.data();
    }
  }
  text += "431.2"; // cut off
  folder_.write("scan.txt", text);
  const auto run = run_bregma(folder_, "register scan scan.txt head.asc --sigma-mm 0.6 --json" + kRaw + kCurve);
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out;
  const auto json = run.json();
  EXPECT_LT(target_error_mm(json), 1.5);
  const auto whole_tens = rows_.size() / 10;
  EXPECT_GE(json["scan"]["missing"].get<std::size_t>(), whole_tens);
  EXPECT_GE(json["scan"]["damaged"].get<std::size_t>(), rows_.size() / 40);
  EXPECT_NE(json["notes"].dump().find("damaged rows"), std::string::npos);
}

TEST_F(ScanOfAHead, JoinedReadingsAreUndoneByTheModulo) {
  // Readings of three digits; the line joined two of them now and then: 412 and 388 become 412388.
  std::string text;
  std::array<char, 120> line{};
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const int reading = static_cast<int>(std::lround(1e5 / rows_[i].z()));
    std::snprintf(line.data(), line.size(), i % 4 == 0 ? "%.2f %.2f 512%d\n" : "%.2f %.2f %d\n", rows_[i].x(),
                  rows_[i].y(), reading);
    text += line.data();
  }
  folder_.write("scan.txt", text);
  const std::string curve = " --scale-mm 1e5 --exponent -1 --json";
  const auto plain = run_bregma(folder_, "register scan scan.txt head.asc" + kRaw + curve);
  EXPECT_EQ(plain.exit_code, 1) << plain.out;
  EXPECT_TRUE(plain.json()["T_target_source"].is_null());
  const auto mended = run_bregma(folder_, "register scan scan.txt head.asc --modulo 1000" + kRaw + curve);
  ASSERT_EQ(mended.exit_code, 0) << mended.err << mended.out;
  EXPECT_LT(target_error_mm(mended.json()), 2.0);
}

TEST_F(ScanOfAHead, ARefusedScanGivesNothingThatCouldBeUsed) {
  folder_.write("scan.txt", records());
  // The curve of another sensor: the face is stretched.
  const auto run =
      run_bregma(folder_, "register scan scan.txt head.asc --scale-mm 100 --exponent -2 --json --tfm no.tfm" + kRaw);
  EXPECT_EQ(run.exit_code, 1) << run.out;
  const auto json = run.json();
  EXPECT_EQ(json["accepted"], false);
  EXPECT_NE(json["verdict"], "found");
  EXPECT_TRUE(json["T_target_source"].is_null());
  EXPECT_TRUE(json["T_source_target"].is_null());
  EXPECT_TRUE(json["covariance"].is_null());
  EXPECT_FALSE(std::filesystem::exists(folder_ / "no.tfm"));
  // Every thousandth of a few hundred records.
  const auto few = run_bregma(folder_, "register scan scan.txt head.asc" + kCurve);
  EXPECT_EQ(few.exit_code, 1);
  EXPECT_NE(few.err.find("say a smaller --every or --window"), std::string::npos) << few.err;
  EXPECT_EQ(few.out, "");
}

TEST_F(ScanOfAHead, AResultThatWasLostIsNoSuccess) {
  folder_.write("scan.txt", records());
  for (const std::string format : {"", " --json"}) {
    const auto run = run_bregma(
        folder_, "register scan scan.txt head.asc --sigma-mm 0.6 --tfm kept.tfm" + kRaw + kCurve + format, kFullDisk);
    EXPECT_EQ(run.exit_code, 2);
    EXPECT_TRUE(run.err.ends_with(kOutputLost)) << run.err;
  }
}

TEST(RegisterScan, InputThatIsNoScanIsRefusedInWords) {
  const TemporaryFolder folder;
  folder.write("head.asc", freesurfer_text(bregma::test::make_head(3)));
  folder.write("empty.txt", "# nothing\n");
  folder.write("header.txt", "x y reading\n");
  folder.write("words.txt", "x y voltage\n1 2 3\n");
  folder.write("twice.txt", "x x_mm reading\n1 2 3\n");
  folder.write("no_reading.txt", "x y\n1 2\n");
  folder.write("prose.txt", "This is not a scan at all\nnor is this\n");
  folder.write("wide.txt", "1 2 3 4\n1 2 3 4\n");
  folder.write("ok.txt", "0 0 2\n1 0 2\n");
  folder.write("distance.txt", "x,y,distance_mm\n0,0,150\n");
  folder.write("bad.json", "{\"accepted\": true, \"scale_mm\": -3, \"exponent\": -1}");
  folder.write("refused.json", "{\"accepted\": false, \"scale_mm\": 130, \"exponent\": -1}");
  folder.write("list.json", "[1, 2]");
  folder.write("falling.json", R"({"accepted": true, "scale_mm": 130, "exponent": -1,
                                   "corrections": [{"reading": 2, "add_mm": 1}, {"reading": 1, "add_mm": 0}]})");
  const std::string options = " --scale-mm 100 --exponent -1";
  const std::vector<std::pair<std::string, std::string>> rows{
      {"empty.txt head.asc" + options, "empty.txt: holds no records"},
      {"header.txt head.asc" + options, "header.txt: holds no records"},
      {"words.txt head.asc" + options, "words.txt:1: column \"voltage\" is not known"},
      {"twice.txt head.asc" + options, "twice.txt:1: the columns \"x\" and \"x_mm\" mean the same"},
      {"no_reading.txt head.asc" + options, "no_reading.txt:1: has no column reading or distance_mm"},
      {"prose.txt head.asc" + options, "prose.txt:1: 2 of 2 rows are not x, y and a reading"},
      {"wide.txt head.asc" + options, "wide.txt:1: 2 of 2 rows are not x, y and a reading"},
      {"gone.txt head.asc" + options, "gone.txt"},
      {"ok.txt head.asc", "holds readings: say the sensor's curve"},
      {"ok.txt head.asc --scale-mm 100", "--scale-mm and --exponent belong together"},
      {"ok.txt head.asc --curve bad.json", "bad.json: holds no curve"},
      {"ok.txt head.asc --curve list.json", "list.json: holds no curve"},
      {"ok.txt head.asc --curve refused.json", "refused.json: this curve was not accepted"},
      {"ok.txt head.asc --curve gone.json", "gone.json"},
      {"ok.txt head.asc --curve falling.json",
       "falling.json: corrections: must hold reading and add_mm, with increasing"},
      {"distance.txt head.asc" + options, "holds distances, which need no --curve"},
      {"ok.txt head.asc --tfm ok.txt" + options, "--tfm"},
      {"ok.txt head.asc --near-mm 200 --far-mm 100" + options, "--near-mm must be below --far-mm"},
  };
  for (const auto &[arguments, words] : rows) {
    SCOPED_TRACE(arguments);
    const auto run = run_bregma(folder, "register scan " + arguments);
    EXPECT_EQ(run.exit_code, 2);
    EXPECT_NE(run.err.find(words), std::string::npos) << run.err;
    EXPECT_EQ(run.out, "");
  }
}

} // namespace
