#include "casefile/volumes/volume.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <sstream>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include "casefile/volumes/label_names.hpp"
#include "files.hpp"

namespace bregma::casefile {
namespace {

using test::TemporaryFolder;
using test::write_bytes;

// An image without symmetry: a bright corner, and ramps of different slope along the axes.
Volume pattern(const Eigen::Matrix3d &R) {
  Volume volume;
  volume.size = {5, 6, 7};
  volume.T_image_index.topLeftCorner<3, 3>() = R * Eigen::Vector3d(1.0, 1.5, 2.0).asDiagonal();
  volume.T_image_index.topRightCorner<3, 1>() = Eigen::Vector3d(-12.25, 31.5, 4.75);
  for (int k = 0; k < volume.size[2]; ++k) {
    for (int j = 0; j < volume.size[1]; ++j) {
      for (int i = 0; i < volume.size[0]; ++i) {
        volume.voxels.push_back(static_cast<float>(i + 10 * j + 100 * k + (i == 0 && j == 1 && k == 2 ? 1000 : 0)));
      }
    }
  }
  return volume;
}

// The same image in space, stored in another order: axis `axes[a]` of the original runs along a, reversed if flipped.
Volume stored_otherwise(const Volume &volume, const std::array<int, 3> &axes, int flips) {
  Volume out;
  Eigen::Matrix4d T_old_new = Eigen::Matrix4d::Zero();
  T_old_new(3, 3) = 1.0;
  for (int axis = 0; axis < 3; ++axis) {
    const int old = axes[static_cast<std::size_t>(axis)];
    const int length = volume.size[static_cast<std::size_t>(old)];
    const bool flipped = ((flips >> axis) & 1) != 0;
    out.size[static_cast<std::size_t>(axis)] = length;
    T_old_new(old, axis) = flipped ? -1.0 : 1.0;
    T_old_new(old, 3) = flipped ? length - 1.0 : 0.0;
  }
  out.T_image_index = volume.T_image_index * T_old_new;
  for (int k = 0; k < out.size[2]; ++k) {
    for (int j = 0; j < out.size[1]; ++j) {
      for (int i = 0; i < out.size[0]; ++i) {
        const Eigen::Vector4d old = T_old_new * Eigen::Vector4d(i, j, k, 1.0);
        out.voxels.push_back(volume.at(static_cast<int>(std::lround(old[0])), static_cast<int>(std::lround(old[1])),
                                       static_cast<int>(std::lround(old[2]))));
      }
    }
  }
  return out;
}

std::string bytes_of(const std::vector<float> &voxels) {
  std::string bytes(voxels.size() * sizeof(float), '\0');
  std::memcpy(bytes.data(), voxels.data(), bytes.size());
  return bytes;
}

// Files written directly from the formats' definitions, so that reader and writer cannot have the same error.
std::string nrrd(const Volume &volume, const std::string &space) {
  const Eigen::Vector3d sign =
      space == "right-anterior-superior" ? Eigen::Vector3d(1, 1, 1) : Eigen::Vector3d(-1, -1, 1);
  std::ostringstream out;
  out.precision(17);
  const auto vector = [&](int column) {
    const Eigen::Vector3d v = sign.cwiseProduct(Eigen::Vector3d(volume.T_image_index.col(column).head<3>()));
    out << "(" << v[0] << "," << v[1] << "," << v[2] << ")";
  };
  out << "NRRD0004\ntype: float\ndimension: 3\nspace: " << space << "\nsizes: " << volume.size[0] << " "
      << volume.size[1] << " " << volume.size[2] << "\nspace directions: ";
  vector(0);
  out << " ";
  vector(1);
  out << " ";
  vector(2);
  out << "\nkinds: domain domain domain\nendian: little\nencoding: raw\nspace origin: ";
  vector(3);
  out << "\n\n" << bytes_of(volume.voxels);
  return out.str();
}

std::string meta_image(const Volume &volume) {
  std::ostringstream out;
  out.precision(17);
  out << "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n"
      << "TransformMatrix =";
  const Eigen::Vector3d spacing = volume.spacing_mm();
  for (int column = 0; column < 3; ++column) { // a row of the file is an axis of the image
    const Eigen::Vector3d axis = volume.T_image_index.col(column).head<3>() / spacing[column];
    out << " " << -axis[0] << " " << -axis[1] << " " << axis[2];
  }
  out << "\nOffset = " << -volume.T_image_index(0, 3) << " " << -volume.T_image_index(1, 3) << " "
      << volume.T_image_index(2, 3) << "\nElementSpacing = " << spacing[0] << " " << spacing[1] << " " << spacing[2]
      << "\nDimSize = " << volume.size[0] << " " << volume.size[1] << " " << volume.size[2]
      << "\nElementType = MET_FLOAT\nElementDataFile = LOCAL\n"
      << bytes_of(volume.voxels);
  return out.str();
}

template <class T> void put(std::string &header, std::size_t at, T value) {
  std::memcpy(header.data() + at, &value, sizeof value);
}

// Offsets: nifti1.h of the NIfTI-1.1 standard; sform only (method 3), which is RAS.
std::string nifti(const Volume &volume) {
  std::string header(352, '\0');
  put<std::int32_t>(header, 0, 348);
  const std::int16_t dim[8] = {3,
                               static_cast<std::int16_t>(volume.size[0]),
                               static_cast<std::int16_t>(volume.size[1]),
                               static_cast<std::int16_t>(volume.size[2]),
                               1,
                               1,
                               1,
                               1};
  std::memcpy(header.data() + 40, dim, sizeof dim);
  put<std::int16_t>(header, 70, 16); // float32
  put<std::int16_t>(header, 72, 32);
  put<float>(header, 76, 1.0F);
  for (int axis = 0; axis < 3; ++axis) {
    put<float>(header, 80 + 4 * static_cast<std::size_t>(axis), static_cast<float>(volume.spacing_mm()[axis]));
  }
  put<float>(header, 108, 352.0F);
  put<float>(header, 112, 1.0F);     // scl_slope
  put<std::uint8_t>(header, 123, 2); // mm
  put<std::int16_t>(header, 254, 1); // sform_code
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      put<float>(header, 280 + 16 * static_cast<std::size_t>(row) + 4 * static_cast<std::size_t>(column),
                 static_cast<float>(volume.T_image_index(row, column)));
    }
  }
  std::memcpy(header.data() + 344, "n+1", 4);
  return header + bytes_of(volume.voxels);
}

void expect_same(const Volume &expected, const base::Result<Volume> &read, double tolerance_mm,
                 const std::string &what) {
  ASSERT_TRUE(read) << what << ": " << read.error().message;
  EXPECT_EQ(expected.size, read->size) << what;
  EXPECT_LT((expected.T_image_index - read->T_image_index).cwiseAbs().maxCoeff(), tolerance_mm) << what << "\n"
                                                                                                << read->T_image_index;
  EXPECT_EQ(expected.voxels, read->voxels) << what;
}

std::string message_of(const base::Result<Volume> &read) { return read ? "was read" : read.error().message; }

// All 48 orientations of an image in each format give the same image in space.
TEST(Orientation, DoesNotDependOnHowTheImageIsStored) {
  const TemporaryFolder scratch;
  const Eigen::Matrix3d oblique =
      (Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitX()) * Eigen::AngleAxisd(-0.15, Eigen::Vector3d::UnitZ()))
          .toRotationMatrix();
  for (const Eigen::Matrix3d &R : {Eigen::Matrix3d(Eigen::Matrix3d::Identity()), oblique}) {
    const Volume original = pattern(R);
    std::array<int, 3> axes{0, 1, 2};
    int ways = 0;
    do {
      for (int flips = 0; flips < 8; ++flips, ++ways) {
        const Volume stored = stored_otherwise(original, axes, flips);
        const std::string way = "axes " + std::to_string(axes[0]) + std::to_string(axes[1]) + std::to_string(axes[2]) +
                                ", flips " + std::to_string(flips);
        write_bytes(scratch / "lps.nrrd", nrrd(stored, "left-posterior-superior"));
        write_bytes(scratch / "ras.nrrd", nrrd(stored, "right-anterior-superior"));
        write_bytes(scratch / "a.mha", meta_image(stored));
        write_bytes(scratch / "a.nii", nifti(stored));
        ASSERT_TRUE(write_volume(scratch / "own.nrrd", stored));
        ASSERT_TRUE(write_volume(scratch / "own.nii.gz", stored));
        for (const char *file : {"lps.nrrd", "ras.nrrd", "a.mha", "a.nii", "own.nrrd", "own.nii.gz"}) {
          expect_same(original, read_volume(scratch / file), 1e-4, way + ", " + file); // NIfTI has 32-bit matrices
        }
        if (HasFailure()) {
          return;
        }
      }
    } while (std::next_permutation(axes.begin(), axes.end()));
    EXPECT_EQ(48, ways);
  }
}

// nifti1.h: dim[0] from 1 to 7, voxels behind 348 bytes and the four of the extension, a unit quaternion.
TEST(Volume, ANiftiHeaderThatIsDamagedIsRefused) {
  const TemporaryFolder scratch;
  const std::string whole = nifti(pattern(Eigen::Matrix3d::Identity()));
  const auto refusal = [&](const std::function<void(std::string &)> &damage) {
    std::string bytes = whole;
    damage(bytes);
    write_bytes(scratch / "a.nii", bytes);
    return message_of(read_volume(scratch / "a.nii"));
  };
  EXPECT_EQ(refusal([](std::string &) {}), "was read");
  for (const int axes : {0, 8, -3}) {
    EXPECT_NE(refusal([&](std::string &b) {
                put<std::int16_t>(b, 40, static_cast<std::int16_t>(axes));
              }).find("dim[0] = " + std::to_string(axes) + ": must be a number of axes from 1 to 7"),
              std::string::npos);
  }
  for (const float start : {348.0F, 352.5F, -352.0F, std::numeric_limits<float>::quiet_NaN()}) {
    EXPECT_NE(refusal([&](std::string &b) { put<float>(b, 108, start); }).find("is not a place behind the header"),
              std::string::npos)
        << start;
  }
  EXPECT_NE(refusal([](std::string &b) {
              put<float>(b, 112, std::numeric_limits<float>::infinity());
            }).find("scl_slope is not a finite number"),
            std::string::npos);
  EXPECT_NE(refusal([](std::string &b) {
              put<std::int16_t>(b, 252, 1);
              put<float>(b, 256, 3.0F);
            }).find("its qform is no rotation"),
            std::string::npos);
  EXPECT_NE(refusal([](std::string &b) {
              put<std::int16_t>(b, 252, 1);
              put<std::int16_t>(b, 254, 0);
              put<float>(b, 84, -2.0F);
            }).find("a qform needs sizes of voxels above 0"),
            std::string::npos);
}

TEST(Volume, SizesOfVoxelsThatContradictTheSformAreSaid) {
  const TemporaryFolder scratch;
  const Volume original = pattern(Eigen::Matrix3d::Identity());
  std::string bytes = nifti(original);
  write_bytes(scratch / "a.nii", bytes);
  Notes notes;
  expect_same(original, read_volume(scratch / "a.nii", {}, &notes), 1e-4, "as written");
  EXPECT_TRUE(notes.empty());
  put<float>(bytes, 80, 77.0F);
  write_bytes(scratch / "a.nii", bytes);
  expect_same(original, read_volume(scratch / "a.nii", {}, &notes), 1e-4, "with another pixdim");
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_NE(notes[0].find("pixdim states voxels of 77 x "), std::string::npos) << notes[0];
}

double sample(const Volume &volume, const Eigen::Matrix4d &T_index_image, const Eigen::Vector3d &point) {
  const Eigen::Vector3d index = (T_index_image * point.homogeneous()).head<3>();
  const Eigen::Array3i nearest = index.array().round().cast<int>();
  const Eigen::Array3i size(volume.size[0], volume.size[1], volume.size[2]);
  return (nearest < 0).any() || (nearest >= size).any()
             ? 0.0
             : static_cast<double>(volume.at(nearest[0], nearest[1], nearest[2]));
}

// Correlation of b with a at a's voxels; `mirrored`: b is mirrored.
double correlation(const Volume &a, const Volume &b, bool mirrored) {
  const Eigen::Matrix4d T_index_image = b.T_image_index.inverse();
  double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (int k = 0; k < a.size[2]; ++k) {
    for (int j = 0; j < a.size[1]; ++j) {
      for (int i = 0; i < a.size[0]; ++i) {
        Eigen::Vector3d point = a.point_mm({double(i), double(j), double(k)});
        point.x() *= mirrored ? -1.0 : 1.0;
        const double va = a.at(i, j, k);
        const double vb = sample(b, T_index_image, point);
        n += 1, sa += va, sb += vb, saa += va * va, sbb += vb * vb, sab += va * vb;
      }
    }
  }
  return (sab - sa * sb / n) / std::sqrt((saa - sa * sa / n) * (sbb - sb * sb / n));
}

// The same head in two files of different origin, one stored from right to left, the other from left to right.
TEST(Orientation, TwoPublishedFilesOfOneHeadAgree) {
  const auto other = test::shared_data() / "images/mni/single_subj_T1.nii.gz";
  if (!std::filesystem::exists(other) || !std::filesystem::exists(test::templates() / "ch2.nii.gz")) {
    GTEST_SKIP() << "needs " << other << " and mricron-data";
  }
  const auto a = read_volume(other);
  const auto b = read_volume(test::templates() / "ch2.nii.gz");
  ASSERT_TRUE(a && b) << (a ? b.error().message : a.error().message);
  const double right_way = correlation(*a, *b, false);
  const double mirrored = correlation(*a, *b, true);
  EXPECT_GT(right_way, 0.95);
  EXPECT_LT(mirrored, right_way - 0.05);
}

TEST(Orientation, TheHeadOfTheDemonstrationLiesWhereItsFormatSays) {
  if (!std::filesystem::exists(test::templates() / "ch2.nii.gz")) {
    GTEST_SKIP() << "needs mricron-data";
  }
  const auto head = read_volume(test::templates() / "ch2.nii.gz");
  ASSERT_TRUE(head);
  EXPECT_EQ((std::array<int, 3>{181, 217, 181}), head->size);
  EXPECT_TRUE(head->point_mm({0, 0, 0}).isApprox(Eigen::Vector3d(-90, -125, -71)));
  const auto labels = read_labels(test::templates() / "aal.nii.gz");
  const auto names = read_label_names(test::templates() / "aal.nii.txt");
  ASSERT_TRUE(labels && names);
  EXPECT_EQ(116U, names->size());
  EXPECT_EQ("Precentral_L", names->at(1));
  // Check of the sides: the voxels of all regions whose names end with "_L" have a negative mean first coordinate.
  double left = 0.0;
  double right = 0.0;
  for (int k = 0; k < labels->size[2]; ++k) {
    for (int j = 0; j < labels->size[1]; ++j) {
      for (int i = 0; i < labels->size[0]; ++i) {
        if (const auto name = names->find(labels->at(i, j, k)); name != names->end()) {
          const double x = labels->point_mm({double(i), double(j), double(k)}).x();
          (name->second.ends_with("_L") ? left : right) +=
              name->second.ends_with("_L") || name->second.ends_with("_R") ? x : 0;
        }
      }
    }
  }
  EXPECT_LT(left, 0.0);
  EXPECT_GT(right, 0.0);
}

TEST(ReadVolume, SaysWhatIsWrong) {
  const TemporaryFolder scratch;
  const Volume good = pattern(Eigen::Matrix3d::Identity());
  const auto refused = [&](const std::string &name, const std::string &bytes, const std::string &reason) {
    write_bytes(scratch / name, bytes);
    const std::string message = message_of(read_volume(scratch / name));
    EXPECT_NE(std::string::npos, message.find((scratch / name).string())) << name << ": " << message;
    EXPECT_NE(std::string::npos, message.find(reason)) << name << ": " << message;
  };
  EXPECT_EQ("/no/such.nii: no such file or folder", message_of(read_volume("/no/such.nii")));
  refused("text.nii", "this is no image", "is not a NIfTI, NRRD, MetaImage or MGH file that can be read");
  refused("empty.nrrd", "", "is not a NIfTI, NRRD, MetaImage or MGH file that can be read");

  Volume bad = good;
  bad.voxels[17] = std::numeric_limits<float>::quiet_NaN();
  bad.voxels[21] = std::numeric_limits<float>::infinity();
  refused("nan.nrrd", nrrd(bad, "left-posterior-superior"), "2 of 210 voxels are not finite numbers");

  Volume sheared = good;
  sheared.T_image_index(0, 1) = 0.4;
  refused("sheared.nrrd", nrrd(sheared, "left-posterior-superior"), "not at right angles");
  refused("sheared.nii", nifti(sheared), "sheared.nii: the axes of the image are not at right angles");

  Volume singular = good;
  singular.T_image_index.col(1) = singular.T_image_index.col(0);
  refused("singular.nrrd", nrrd(singular, "left-posterior-superior"), "cannot be read: ");
  refused("singular.mha", meta_image(singular), "cannot be read: ");
  refused("singular.nii", nifti(singular), "singular.nii: ");

  std::string nowhere = nifti(good);
  put<std::int16_t>(nowhere, 254, 0);
  refused("nowhere.nii", nowhere, "states no orientation (qform_code and sform_code are both 0)");

  std::string cut = nrrd(good, "left-posterior-superior");
  refused("cut.nrrd", cut.substr(0, cut.size() - 100),
          "cut.nrrd: is not whole: it holds 740 bytes of voxels, its header asks for 840");
  const std::string cut_nifti = nifti(good);
  refused("cut.nii", cut_nifti.substr(0, cut_nifti.size() - 100),
          "is not whole: it holds 740 bytes of voxels, its header asks for 840");

  ASSERT_TRUE(write_volume(scratch / "whole.nii.gz", good));
  const std::string packed = test::read_bytes(scratch / "whole.nii.gz");
  refused("cut.nii.gz", packed.substr(0, packed.size() - 40), "cut.nii.gz: is not whole: ");
  std::string rotten = packed;
  rotten[packed.size() / 2] = static_cast<char>(rotten[packed.size() / 2] ^ 0x55);
  refused("rotten.nii.gz", rotten, "rotten.nii.gz: ");

  std::string empty = nifti(good);
  put<std::int16_t>(empty, 44, 0);
  refused("empty.nii", empty, "the image is empty: 5 x 0 voxels");
  std::string series = nifti(good);
  put<std::int16_t>(series, 40, 4);
  put<std::int16_t>(series, 48, 3);
  refused("time.nii", series, "has more than three dimensions: 5 x 6 x 7 x 3");
  std::string huge = nifti(good);
  for (const std::size_t at : {42U, 44U, 46U}) {
    put<std::int16_t>(huge, at, 30'000);
  }
  refused("huge.nii", huge, "the image is too large");
  refused("flat.nrrd", "NRRD0004\ntype: uchar\ndimension: 2\nsizes: 2 2\nencoding: raw\n\nabcd",
          "the image has 2 dimensions (2 x 2), a volume has three");
}

TEST(ReadLabels, TakesWholeNumbersOnly) {
  const TemporaryFolder scratch;
  Volume volume = pattern(Eigen::Matrix3d::Identity());
  ASSERT_TRUE(write_volume(scratch / "l.nrrd", volume));
  const auto labels = read_labels(scratch / "l.nrrd");
  ASSERT_TRUE(labels);
  EXPECT_EQ(6 + 610 - 6, labels->at(0, 1, 6));
  volume.voxels[3] = 2.5F;
  ASSERT_TRUE(write_volume(scratch / "l.nrrd", volume));
  const auto refused = read_labels(scratch / "l.nrrd");
  ASSERT_FALSE(refused);
  EXPECT_NE(std::string::npos,
            refused.error().message.find("l.nrrd: is not a label image: it has a voxel of value 2.500"))
      << refused.error().message;
}

TEST(WriteVolume, RefusesFormatsThatItDoesNotKnow) {
  const auto written = write_volume("/tmp/a.png", pattern(Eigen::Matrix3d::Identity()));
  ASSERT_FALSE(written);
  EXPECT_EQ("/tmp/a.png: cannot be written: the extension is none of .nii, .nii.gz, .nrrd, .mha",
            written.error().message);
  const auto nowhere = write_volume("/nonexistent/a.nrrd", pattern(Eigen::Matrix3d::Identity()));
  ASSERT_FALSE(nowhere);
  EXPECT_EQ("/nonexistent/a.nrrd: cannot be written: its folder does not exist", nowhere.error().message);
}

} // namespace
} // namespace bregma::casefile
