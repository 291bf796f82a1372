// A case folder becomes the files that a display needs, exactly.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "casefile/case.hpp"
#include "casefile/sha256.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/case_server/case_bundle.hpp"
#include "clients/casefiles/manifest.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace bregma::case_server {
namespace {

using nlohmann::json;

// 3 x 4 x 2 voxels of 2 x 1 x 3 mm, turned by nothing.
casefile::Volume volume(const std::vector<float> &first) {
  casefile::Volume out;
  out.size = {3, 4, 2};
  out.T_image_index.diagonal() << 2.0, 1.0, 3.0, 1.0;
  out.T_image_index.topRightCorner<3, 1>() << -10.0, 5.0, 7.0;
  out.voxels.assign(24, 1.0F);
  std::copy(first.begin(), first.end(), out.voxels.begin());
  return out;
}

class BundleTest : public ::testing::Test {
protected:
  casefiles::Bundle bundle(const std::vector<float> &voxels) {
    const auto written = casefile::write_volume(folder_ / "image.nii.gz", volume(voxels));
    EXPECT_TRUE(written) << written.error().message;
    case_ = tests::sample_case(folder_.path());
    EXPECT_TRUE(casefile::save_case(case_));
    auto out = bundle_of(folder_.path(), 0);
    EXPECT_TRUE(out) << out.error().message;
    return out ? *out : casefiles::Bundle{};
  }
  template <class T> static std::vector<T> content(const casefiles::Bundle &bundle, const json &entry) {
    const auto &bytes = bundle.files.at(*casefile::from_hex(entry["sha256"].get<std::string>()));
    std::vector<T> out(bytes.size() / sizeof(T));
    std::memcpy(out.data(), bytes.data(), out.size() * sizeof(T));
    return out;
  }

  test::TemporaryFolder folder_;
  casefile::Case case_;
};

TEST_F(BundleTest, ARegisteredImageKeepsItsGridAndStatesItsTransformAndError) {
  ASSERT_TRUE(casefile::write_volume(folder_ / "image.nii.gz", volume({7})));
  std::filesystem::create_directories(folder_ / "images");
  ASSERT_TRUE(casefile::write_volume(folder_ / "images/t2.nii.gz", volume({0.5F, 2.5F})));
  case_ = tests::sample_case(folder_.path());
  casefile::RegisteredImage image;
  image.name = "T2 new";
  image.file = folder_ / "images/t2.nii.gz";
  image.verdict = "found";
  image.T_image_source.pose = {Eigen::Quaterniond::Identity(), {1.0, 2.0, 3.0}};
  image.T_image_source.covariance = 0.01 * geometry::Matrix6d::Identity();
  image.T_image_source.covariance.topLeftCorner<3, 3>() *= 1e-3;
  image.sha256 = casefile::to_hex(*casefile::sha256_of_file(image.file));
  image.planning_sha256 = casefile::to_hex(*casefile::sha256_of_file(case_.image));
  casefile::put_image(case_, image);
  case_.targets.push_back({"Cyst", {10.0, 0.0, 20.0}, "T2 new"});
  casefile::map_to_image(case_, case_.targets.back());
  const auto saved = casefile::save_case(case_);
  ASSERT_TRUE(saved) << saved.error().message;
  const auto out = bundle_of(folder_.path(), 0);
  ASSERT_TRUE(out) << out.error().message;

  const auto manifest = casefiles::read_manifest(out->manifest);
  ASSERT_TRUE(manifest) << manifest.error().message;
  EXPECT_EQ(manifest->files.count("image/T2_new"), 1U);
  const json root = json::parse(manifest->json);
  ASSERT_EQ(root["images"].size(), 1U);
  const json &entry = root["images"][0];
  EXPECT_EQ(entry["name"], "T2 new");
  EXPECT_EQ(entry["url"], "/case/" + root["hash"].get<std::string>() + "/image/T2_new");
  EXPECT_EQ(entry["type"], "float32");
  EXPECT_EQ(content<float>(*out, entry)[1], 2.5F);
  EXPECT_EQ(entry["dims"], json::array({3, 4, 2}));
  EXPECT_NEAR(entry["T_ras_voxel"][3].get<double>(), -9.0, 1e-9) << "its own grid, in the planning image";
  EXPECT_EQ(entry["T_image_source"],
            json::array({1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0}));
  EXPECT_EQ(entry["covariance"].size(), 36U);
  const json &cyst = root["targets"][1];
  EXPECT_EQ(cyst["placed_in"], "T2 new");
  EXPECT_NEAR(cyst["position_mm"][0].get<double>(), 11.0, 1e-9);
  EXPECT_NEAR(cyst["image_rms_mm"].get<double>(), std::sqrt(case_.targets.back().placing_covariance_mm2.trace()), 1e-9);
  EXPECT_FALSE(root["targets"][0].contains("placed_in"));
}

TEST_F(BundleTest, LabelsAreTheirBoundingBoxWithNamesAndColours) {
  for (const auto &[value, type] : {std::pair{255.0F, "uint8"}, {256.0F, "int16"}}) {
    casefile::Volume labels = volume({});
    std::fill(labels.voxels.begin(), labels.voxels.end(), 0.0F);
    labels.voxels[labels.offset(1, 2, 1)] = 4.0F;
    labels.voxels[labels.offset(2, 2, 1)] = value;
    ASSERT_TRUE(casefile::write_volume(folder_ / "image.nii.gz", volume({3})));
    ASSERT_TRUE(casefile::write_volume(folder_ / "labels.nii.gz", labels));
    folder_.write("labels.txt", "4 1 2 3 1 1 1 \"Cuneus_L\"\n" + std::to_string(static_cast<int>(value)) +
                                    " 171 205 239 1 1 1 \"Tumour\"\n");
    case_ = tests::sample_case(folder_.path());
    case_.labels = casefile::LabelImage{folder_ / "labels.nii.gz", folder_ / "labels.txt"};
    ASSERT_TRUE(casefile::save_case(case_));
    const auto out = bundle_of(folder_.path(), 0);
    ASSERT_TRUE(out) << out.error().message;
    const auto manifest = casefiles::read_manifest(out->manifest);
    ASSERT_TRUE(manifest) << manifest.error().message;
    EXPECT_EQ(manifest->files.count("labels"), 1U);
    const json entry = json::parse(manifest->json)["labels"];
    EXPECT_EQ(entry["type"], type);
    EXPECT_EQ(entry["dims"], json::array({2, 1, 1}));
    EXPECT_EQ(entry["T_ras_voxel"],
              json::parse("[2.0, 0.0, 0.0, -8.0,  0.0, 1.0, 0.0, 7.0,  0.0, 0.0, 3.0, 10.0,  0.0, 0.0, 0.0, 1.0]"));
    EXPECT_EQ(entry["regions"][0], (json{{"value", 4}, {"name", "Cuneus_L"}, {"colour", "#010203"}}));
    EXPECT_EQ(entry["regions"][1]["colour"], "#abcdef");
    if (std::string(type) == "uint8") {
      EXPECT_EQ(content<std::uint8_t>(*out, entry), (std::vector<std::uint8_t>{4, 255}));
    } else {
      EXPECT_EQ(content<std::int16_t>(*out, entry), (std::vector<std::int16_t>{4, 256}));
    }
  }
  folder_.write("labels.txt", "no table\n");
  const auto broken = bundle_of(folder_.path(), 0);
  ASSERT_FALSE(broken);
  EXPECT_NE(broken.error().message.find("labels.txt"), std::string::npos);
}

TEST_F(BundleTest, VoxelsAreExactInTheSmallestTypeThatHoldsThem) {
  const auto image = [](const casefiles::Bundle &bundle) { return json::parse(bundle.manifest)["image"]; };
  {
    const auto out = bundle({-1024, 3071});
    EXPECT_EQ(image(out)["type"], "int16");
    EXPECT_EQ(content<std::int16_t>(out, image(out))[1], 3071);
    EXPECT_EQ(content<std::int16_t>(out, image(out))[0], -1024);
    EXPECT_EQ(image(out)["min"], -1024.0);
  }
  {
    const auto out = bundle({65535});
    EXPECT_EQ(image(out)["type"], "uint16");
    EXPECT_EQ(content<std::uint16_t>(out, image(out))[0], 65535);
  }
  {
    const auto out = bundle({255, 0});
    EXPECT_EQ(image(out)["type"], "uint8");
    EXPECT_EQ(content<std::uint8_t>(out, image(out)),
              (std::vector<std::uint8_t>{255, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1}));
  }
  {
    const auto out = bundle({0.5F});
    EXPECT_EQ(image(out)["type"], "float32");
    EXPECT_EQ(content<float>(out, image(out))[0], 0.5F);
  }
}

TEST_F(BundleTest, TheManifestStatesGridPlansToolsAndMeshes) {
  const auto out = bundle({3});
  EXPECT_EQ(out.case_id, case_.id);
  const json root = json::parse(out.manifest);
  EXPECT_EQ(root["image"]["dims"], json::parse("[3, 4, 2]"));
  EXPECT_EQ(root["image"]["T_ras_voxel"],
            json::parse("[2.0, 0.0, 0.0, -10.0,  0.0, 1.0, 0.0, 5.0,  0.0, 0.0, 3.0, 7.0,  0.0, 0.0, 0.0, 1.0]"));
  ASSERT_EQ(root["tools"].size(), case_.tools.size());
  EXPECT_EQ(root["tools"][0]["name"], case_.tools[0].name);
  EXPECT_EQ(root["fiducials"].size(), case_.fiducials.size());
  EXPECT_EQ(root["trajectories"].size(), case_.trajectories.size());
  ASSERT_EQ(root["meshes"].size(), 2 + case_.structures.size());
  const json &scalp = root["meshes"][0];
  const auto mesh = content<std::uint32_t>(out, scalp);
  EXPECT_EQ(mesh[0], case_.scalp.mesh.vertices_mm.size());
  EXPECT_EQ(mesh[1], case_.scalp.mesh.triangles.size());
  EXPECT_EQ(mesh.size(), 2 + 3 * (mesh[0] + mesh[1]));
  EXPECT_EQ(static_cast<int>(mesh.back()), case_.scalp.mesh.triangles.back().z());
  EXPECT_EQ(content<float>(out, scalp)[2], static_cast<float>(case_.scalp.mesh.vertices_mm[0].x()));
  EXPECT_TRUE(casefiles::read_manifest(out.manifest));
}

TEST_F(BundleTest, TheSameFolderIsTheSameCase) { EXPECT_EQ(bundle({3}).manifest, bundle({3}).manifest); }

TEST_F(BundleTest, ACaseWhoseImageCannotBeReadIsAnErrorThatNamesTheFile) {
  (void)bundle({3});
  folder_.write("image.nii.gz", "no image");
  const auto broken = bundle_of(folder_.path(), 0);
  ASSERT_FALSE(broken);
  EXPECT_NE(broken.error().message.find("image.nii.gz"), std::string::npos);
}

} // namespace
} // namespace bregma::case_server
