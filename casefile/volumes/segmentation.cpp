#include "casefile/volumes/segmentation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Eigenvalues> // before ITK brings its own, older copy
#include <itkBinaryFillholeImageFilter.h>
#include <itkBinaryShapeKeepNObjectsImageFilter.h>
#include <itkExtractImageFilter.h>
#include <itkImage.h>
#include <itkImageRegionConstIterator.h>
#include <itkImageRegionIterator.h>
#include <itkOtsuThresholdImageFilter.h>
#include <itkSignedMaurerDistanceMapImageFilter.h>
#include <itkSmoothingRecursiveGaussianImageFilter.h>

#include "casefile/volumes/crop.hpp"
#include "casefile/volumes/itk_grid.hpp"

namespace bregma::casefile {
namespace {

using Mask = itk::Image<std::uint8_t, 3>;
using Slice = itk::Image<std::uint8_t, 2>;

struct Padding {
  std::array<int, 3> voxels{}; // on each side, along i, j, k
};

Padding padding_of(const Eigen::Vector3d &spacing, const SurfaceOptions &options) {
  Padding padding;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double reach_mm = options.closing_mm + 4.0 * options.blur_mm;
    padding.voxels[axis] = 2 + static_cast<int>(std::ceil(reach_mm / spacing[static_cast<Eigen::Index>(axis)]));
  }
  return padding;
}

template <class Voxel, class Inside>
Mask::Pointer padded_mask(const image::Image<Voxel, 3> &volume, const Padding &padding, const Inside &inside) {
  auto mask = Mask::New();
  Mask::SizeType size;
  Mask::SpacingType spacing;
  for (unsigned axis = 0; axis < 3; ++axis) {
    size[axis] =
        static_cast<itk::SizeValueType>(volume.size[axis]) + 2 * static_cast<itk::SizeValueType>(padding.voxels[axis]);
    spacing[axis] = volume.spacing_mm()[axis];
  }
  mask->SetRegions(size);
  mask->SetSpacing(spacing);
  mask->Allocate();
  mask->FillBuffer(0);
  std::uint8_t *const to = mask->GetBufferPointer();
  const auto row = static_cast<std::size_t>(size[0]);
  for (int k = 0; k < volume.size[2]; ++k) {
    for (int j = 0; j < volume.size[1]; ++j) {
      const auto line = (static_cast<std::size_t>(k + padding.voxels[2]) * size[1] +
                         static_cast<std::size_t>(j + padding.voxels[1])) *
                            row +
                        static_cast<std::size_t>(padding.voxels[0]);
      const std::size_t from = volume.offset(0, j, k);
      for (std::size_t i = 0; i < static_cast<std::size_t>(volume.size[0]); ++i) {
        to[line + i] = inside(volume.voxels[from + i]) ? 1 : 0;
      }
    }
  }
  return mask;
}

double otsu_threshold(const Volume &volume) {
  auto image = ItkVolume::New();
  image->SetRegions(ItkVolume::SizeType{static_cast<itk::SizeValueType>(volume.size[0]),
                                        static_cast<itk::SizeValueType>(volume.size[1]),
                                        static_cast<itk::SizeValueType>(volume.size[2])});
  image->Allocate();
  std::copy(volume.voxels.begin(), volume.voxels.end(), image->GetBufferPointer());
  auto filter = itk::OtsuThresholdImageFilter<ItkVolume, Mask>::New();
  filter->SetInput(image);
  filter->SetNumberOfHistogramBins(256);
  filter->Update();
  return filter->GetThreshold();
}

Mask::Pointer largest_component(const Mask::Pointer &mask) {
  auto filter = itk::BinaryShapeKeepNObjectsImageFilter<Mask>::New();
  filter->SetInput(mask);
  filter->SetForegroundValue(1);
  filter->SetBackgroundValue(0);
  filter->SetNumberOfObjects(1);
  filter->SetAttribute("NumberOfPixels");
  filter->Update();
  return filter->GetOutput();
}

// Sets the ball-shaped neighbourhood of all voxels of `value` to that value: dilation for 1, erosion for 0. The two are
// exact duals, so closing never removes a voxel.
Mask::Pointer grown(const Mask::Pointer &mask, std::uint8_t value, double radius_mm) {
  const auto count = mask->GetLargestPossibleRegion().GetNumberOfPixels();
  auto out = Mask::New();
  out->CopyInformation(mask);
  out->SetRegions(mask->GetLargestPossibleRegion());
  out->Allocate();
  std::uint8_t *const to = out->GetBufferPointer();
  std::transform(mask->GetBufferPointer(), mask->GetBufferPointer() + count, to,
                 [value](std::uint8_t v) { return v == value ? 1 : 0; });
  auto distance = itk::SignedMaurerDistanceMapImageFilter<Mask, ItkVolume>::New();
  distance->SetInput(out);
  distance->SetUseImageSpacing(true);
  distance->SetSquaredDistance(false);
  distance->SetInsideIsPositive(false);
  distance->Update();
  const float *const from = distance->GetOutput()->GetBufferPointer();
  std::transform(from, from + count, to, [value, radius_mm](float d) {
    return static_cast<std::uint8_t>(static_cast<double>(d) <= radius_mm ? value : 1 - value);
  });
  return out;
}

template <class ImageType> typename ImageType::Pointer filled(const ImageType *mask) {
  auto filter = itk::BinaryFillholeImageFilter<ImageType>::New();
  filter->SetInput(mask);
  filter->SetForegroundValue(1);
  filter->Update();
  return filter->GetOutput();
}

// Fills slice by slice along k: airways that are open where the image cuts the neck are closed in the slices above.
void fill_slices(const Mask::Pointer &mask) {
  const auto whole = mask->GetLargestPossibleRegion();
  for (itk::IndexValueType k = 0; k < static_cast<itk::IndexValueType>(whole.GetSize(2)); ++k) {
    auto region = whole;
    region.SetIndex(2, k);
    region.SetSize(2, 0);
    auto extract = itk::ExtractImageFilter<Mask, Slice>::New();
    extract->SetInput(mask);
    extract->SetExtractionRegion(region);
    extract->SetDirectionCollapseToIdentity();
    extract->Update();
    const Slice::Pointer slice = filled<Slice>(extract->GetOutput());
    region.SetSize(2, 1);
    itk::ImageRegionConstIterator<Slice> from(slice, slice->GetLargestPossibleRegion());
    itk::ImageRegionIterator<Mask> to(mask, region);
    for (; !to.IsAtEnd(); ++to, ++from) {
      to.Set(from.Get());
    }
  }
}

ItkVolume::Pointer blurred(const Mask::Pointer &mask, double sigma_mm) {
  if (sigma_mm > 0.0) {
    auto blur = itk::SmoothingRecursiveGaussianImageFilter<Mask, ItkVolume>::New();
    blur->SetInput(mask);
    blur->SetSigma(sigma_mm);
    blur->Update();
    return blur->GetOutput();
  }
  auto image = ItkVolume::New();
  image->SetRegions(mask->GetLargestPossibleRegion());
  image->Allocate();
  std::copy_n(mask->GetBufferPointer(), mask->GetLargestPossibleRegion().GetNumberOfPixels(),
              image->GetBufferPointer());
  return image;
}

Field as_field(const Mask::Pointer &mask, double blur_mm, const Padding &padding,
               const Eigen::Matrix4d &T_image_index) {
  const ItkVolume::Pointer image = blurred(mask, blur_mm);
  const auto count = mask->GetLargestPossibleRegion().GetNumberOfPixels();
  Field field;
  Eigen::Matrix4d T_unpadded = Eigen::Matrix4d::Identity();
  for (unsigned axis = 0; axis < 3; ++axis) {
    field.grid.size[axis] = static_cast<int>(mask->GetLargestPossibleRegion().GetSize(axis));
    T_unpadded(axis, 3) = -padding.voxels[axis];
  }
  field.grid.T_image_index = T_image_index * T_unpadded;
  field.grid.voxels.assign(image->GetBufferPointer(), image->GetBufferPointer() + count);
  return field;
}

bool is_empty(const Mask::Pointer &mask) {
  const std::uint8_t *const from = mask->GetBufferPointer();
  const auto count = mask->GetLargestPossibleRegion().GetNumberOfPixels();
  return std::all_of(from, from + count, [](std::uint8_t v) { return v == 0; });
}

// The mask after clefts and holes are closed.
Mask::Pointer closed(Mask::Pointer mask, const SurfaceOptions &options, const Step &step) {
  if (options.closing_mm > 0.0) {
    step(0.3, "closing clefts");
    mask = grown(mask, 1, options.closing_mm);
    step(0.5, "closing clefts");
    mask = grown(mask, 0, options.closing_mm);
  }
  step(0.7, "filling holes");
  if (options.fill_holes) {
    mask = filled<Mask>(mask);
  }
  if (options.fill_slices) {
    fill_slices(mask);
  }
  step(0.85, "smoothing the mask");
  return mask;
}

} // namespace

base::Result<Field> object_field(const Volume &volume, const SurfaceOptions &options, const Step &step) {
  step(0.0, "threshold");
  const double threshold = options.threshold ? *options.threshold : otsu_threshold(volume);
  const Padding padding = padding_of(volume.spacing_mm(), options);
  const Mask::Pointer mask =
      padded_mask(volume, padding, [threshold](float v) { return static_cast<double>(v) > threshold; });
  if (is_empty(mask)) {
    return base::failure("no voxel is above the threshold of " + shown(threshold, 3));
  }
  step(0.1, "largest component");
  const Mask::Pointer object = closed(largest_component(mask), options, step);
  Field out = as_field(object, options.blur_mm, padding, volume.T_image_index);
  out.threshold = threshold;
  return out;
}

base::Result<Field> region_field(const LabelVolume &volume, std::span<const std::int16_t> labels,
                                 const SurfaceOptions &options, const Step &step) {
  step(0.0, "regions");
  const auto carries_label = [labels](std::int16_t v) {
    return std::find(labels.begin(), labels.end(), v) != labels.end();
  };
  if (std::none_of(volume.voxels.begin(), volume.voxels.end(), carries_label)) {
    return base::failure("no voxel carries the label");
  }
  const LabelVolume part = cropped(volume, carries_label);
  const Padding padding = padding_of(part.spacing_mm(), options);
  const Mask::Pointer mask = closed(padded_mask(part, padding, carries_label), options, step);
  return as_field(mask, options.blur_mm, padding, part.T_image_index);
}

} // namespace bregma::casefile
