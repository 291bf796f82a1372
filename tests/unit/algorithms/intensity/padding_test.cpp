// Padding is left out; air, a masked background and outliers are not.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "algorithms/intensity/padding.hpp"
#include "tests/unit/algorithms/intensity/phantom.hpp"

namespace bregma::intensity {
namespace {

// In HU: air, noise, and the body.
Volume ct() {
  Volume out = test::head_phantom();
  for (std::size_t i = 0; i < out.voxels.size(); ++i) {
    const float noise = static_cast<float>((i * 7919) % 23) - 11.0F;
    out.voxels[i] = std::max(-1000.0F + 10.0F * out.voxels[i] + noise, -1024.0F);
  }
  return out;
}

bool outside_circle(const Volume &image, std::size_t i) {
  const Eigen::Vector3d p = image.pixel_mm(i);
  return std::hypot(p.x(), p.y()) > 33.0;
}

TEST(Padding, IsLeftOutOutsideTheCircleOfAScan) {
  for (const float value : {-2000.0F, -3024.0F, -32768.0F}) {
    Volume image = ct();
    std::size_t outside = 0;
    for (std::size_t i = 0; i < image.voxels.size(); ++i) {
      if (outside_circle(image, i)) {
        image.voxels[i] = value;
        ++outside;
      }
    }
    // Some are between the padding and the scan, by an interpolation.
    image.voxels[image.offset(17, 18, 15)] = 0.8F * value - 200.0F;
    const Padding found = leave_out_padding(image);
    EXPECT_EQ(found.value, value);
    EXPECT_EQ(found.voxels, outside + 1);
    for (std::size_t i = 0; i < image.voxels.size(); ++i) {
      ASSERT_TRUE(std::isnan(image.voxels[i]) || image.voxels[i] >= -1024.0F);
    }
  }
}

TEST(Padding, AirAndAMaskedBackgroundAreParts) {
  Volume image = ct();
  EXPECT_EQ(leave_out_padding(image).voxels, 0U) << "air";
  for (std::size_t i = 0; i < image.voxels.size(); ++i) {
    image.voxels[i] = outside_circle(image, i) ? -1024.0F : image.voxels[i];
  }
  EXPECT_EQ(leave_out_padding(image).voxels, 0U) << "of the value of air";
  image = test::head_phantom();
  for (float &v : image.voxels) {
    v = v > 50.0F ? v : 0.0F; // without its skull
  }
  EXPECT_EQ(leave_out_padding(image).voxels, 0U) << "a masked background";
  image = ct();
  image.voxels[5] = -32768.0F;
  EXPECT_EQ(leave_out_padding(image).voxels, 0U) << "a single outlier";
  std::fill(image.voxels.begin(), image.voxels.end(), -5.0F);
  EXPECT_EQ(leave_out_padding(image).voxels, 0U) << "one value";
}

} // namespace
} // namespace bregma::intensity
