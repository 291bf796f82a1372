#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <Eigen/Geometry>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/intensity/resolution.hpp"
#include "algorithms/intensity/warp.hpp"
#include "bench/accuracy/intensity_parts.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::bench {

using Eigen::Vector3d;
using intensity::Volume;

int bench_threads() { return 2; }

double uniform(std::mt19937_64 &rng) { return static_cast<double>(rng() >> 11U) * 0x1.0p-52 - 1.0; }

double normal(std::mt19937_64 &rng) { // Box and Muller
  const double u = 0.5 * (uniform(rng) + 1.0);
  return std::sqrt(-2.0 * std::log(1.0 - u)) * std::cos(3.14159265358979323846 * uniform(rng));
}

Vector3d direction(std::mt19937_64 &rng) {
  const Vector3d v(normal(rng), normal(rng), normal(rng));
  return v.normalized();
}

Volume load_volume(const std::string &path) {
  casefile::Notes notes;
  auto volume = casefile::read_volume(path, {}, &notes);
  if (!volume) {
    throw std::runtime_error(volume.error().message);
  }
  return *volume;
}

Volume plane_of(const Volume &image, double z_mm) {
  constexpr int kPixels = 256;
  const Vector3d last(image.size[0] - 1, image.size[1] - 1, image.size[2] - 1);
  const Vector3d centre = image.point_mm(0.5 * last);
  Volume out;
  out.size = {kPixels, kPixels, 1};
  out.T_image_index.topRightCorner<3, 1>() = Vector3d(-0.5 * (kPixels - 1), -0.5 * (kPixels - 1), 0.0);
  const Vector3d slice(centre.x(), centre.y(), z_mm);
  out.voxels = intensity::warp<3>(out, image, image.voxels, [&](const Vector3d &p) -> Vector3d { return p + slice; });
  const intensity::GreyRange range = intensity::grey_range(image.voxels);
  for (float &v : out.voxels) {
    v = std::isfinite(v) ? (v - range.low) / (range.high - range.low) : 0.0F;
  }
  const intensity::GreyRange of_slice = intensity::grey_range(out.voxels);
  for (float &v : out.voxels) {
    v = (v - of_slice.low) / (of_slice.high - of_slice.low);
  }
  return out;
}

Volume with_noise(Volume image, double variance, unsigned seed) {
  std::mt19937_64 rng(seed);
  for (float &v : image.voxels) {
    v = std::clamp(v + static_cast<float>(std::sqrt(variance) * normal(rng)), 0.0F, 1.0F);
  }
  return image;
}

Volume with_field_of_view(Volume image, double fraction) {
  for (int j = 0; j < image.size[1]; ++j) {
    for (int i = 0; i < image.size[0]; ++i) {
      const double x = std::abs(2.0 * i - image.size[0] + 1.0) / image.size[0];
      const double y = std::abs(2.0 * j - image.size[1] + 1.0) / image.size[1];
      if (std::max(x, y) > fraction) {
        image.voxels[image.offset(i, j, 0)] = std::numeric_limits<float>::quiet_NaN();
      }
    }
  }
  return image;
}

intensity::MeasureOptions as_printed() {
  intensity::MeasureOptions out;
  out.bins = 256;
  out.interpolation = intensity::Interpolation::kNearest;
  out.outside = intensity::Outside::kDark;
  return out;
}

intensity::MeasureOptions off_grid() {
  intensity::MeasureOptions out;
  out.max_samples = 32'768;
  return out;
}

Planes::Planes(const IntensityOptions &options)
    : ct(plane_of(load_volume(options.mni + "/scct.nii.gz"), kSlice_mm)),
      t1(plane_of(load_volume(options.mni + "/avg152T1.nii.gz"), kSlice_mm)),
      t2(plane_of(load_volume(options.mni + "/avg152T2.nii.gz"), kSlice_mm)),
      pd(plane_of(load_volume(options.mni + "/avg152PD.nii.gz"), kSlice_mm)) {}

std::vector<double> similarity_curve(intensity::SimilarityMeasure &measure, const Sweep &sweep) {
  std::vector<double> out;
  for (int at = -sweep.reach; at <= sweep.reach; ++at) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    if (sweep.rotation) {
      T.rotate(Eigen::AngleAxisd(at * geometry::kRadiansPerDegree, Vector3d::UnitZ()));
    } else {
      T.translate(Vector3d(at, 0.0, 0.0));
    }
    out.push_back(measure.value(T.matrix()));
  }
  return out;
}

int largest_at(intensity::SimilarityMeasure &measure, const Sweep &sweep) {
  const std::vector<double> curve = similarity_curve(measure, sweep);
  int best = sweep.reach + 1;
  double largest = -std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < curve.size(); ++i) {
    if (curve[i] > largest) {
      largest = curve[i];
      best = static_cast<int>(i) - sweep.reach;
    }
  }
  return best;
}

SyntheticPair synthetic_pair(const Volume &head, const SyntheticOptions &options, std::mt19937_64 &rng,
                             parallel::Team &team) {
  SyntheticPair out;
  const double noise = 0.02 + 0.035 * (uniform(rng) + 1.0); // 2 to 9 % of the range
  out.reference = options.spacing_mm > 1.2 ? intensity::shrunk(head, options.spacing_mm, team) : head;
  const intensity::GreyRange range = intensity::grey_range(out.reference.voxels, 0.001);
  for (float &v : out.reference.voxels) {
    v += static_cast<float>(0.5 * noise * static_cast<double>(range.high - range.low) * normal(rng));
  }
  const double angle = options.rotation_deg * geometry::kRadiansPerDegree * uniform(rng);
  const Vector3d shift = options.translation_mm * Vector3d(uniform(rng), uniform(rng), uniform(rng));
  out.truth = {Eigen::Quaterniond(Eigen::AngleAxisd(angle, direction(rng))), shift};
  // The floating image looks at the same place of the head.
  const Vector3d last(head.size[0] - 1, head.size[1] - 1, head.size[2] - 1);
  const Vector3d centre = out.truth.inverse() * head.point_mm(0.5 * last);
  const double field = options.min_field + (1.0 - options.min_field) * 0.5 * (uniform(rng) + 1.0);
  out.floating.size = out.reference.size;
  out.floating.size[2] = static_cast<int>(field * out.reference.size[2]);
  for (int d = 0; d < 3; ++d) {
    out.floating.T_image_index(d, d) = options.spacing_mm;
    out.floating.T_image_index(d, 3) =
        centre[d] - 0.5 * options.spacing_mm * (out.floating.size[static_cast<std::size_t>(d)] - 1);
  }
  const Volume soft = intensity::smoothed(head, 0.5 * options.spacing_mm, team);
  out.floating.voxels = intensity::warp<3>(
      out.floating, soft, soft.voxels, [&](const Vector3d &p) { return out.truth * p; }, team);
  const intensity::GreyRange grey = intensity::grey_range(out.floating.voxels, 0.001);
  const Vector3d bias = 0.002 * Vector3d(uniform(rng), uniform(rng), uniform(rng)); // per mm: up to 20 % at 100 mm
  for (std::size_t i = 0; i < out.floating.voxels.size(); ++i) {
    float &v = out.floating.voxels[i];
    const double y = std::isfinite(v) ? static_cast<double>((v - grey.low) / (grey.high - grey.low)) : 0.0;
    const double mapped = y < 0.15 ? 0.5 * y : 0.9 * std::sin(2.6 * y);
    v = static_cast<float>(255.0 *
                           (mapped * (1.0 + bias.dot(out.floating.pixel_mm(i) - centre)) + noise * normal(rng)));
  }
  return out;
}

} // namespace bregma::bench
