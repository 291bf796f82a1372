// ITK's linear resample of planes through an image, for the comparison with the page's pictures.
//
//   display_itk_resample IMAGE.mha PLANES OUTPUT
//
// PLANES has one plane per line: centre, right, up (9 numbers, mm), mm per pixel, pixels per side. OUTPUT gets the
// values of all planes as float64, row by row from the lower left corner; NaN outside the image.
#include <cstdio>
#include <exception>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include <itkImage.h>
#include <itkImageFileReader.h>
#include <itkLinearInterpolateImageFunction.h>
#include <itkMetaImageIOFactory.h>
#include <itkResampleImageFilter.h>

namespace {

using Image = itk::Image<double, 3>;

struct Plane {
  itk::Vector<double, 3> centre, right, up;
  double mm_per_pixel = 1.0;
  unsigned pixels = 0;
};

std::vector<Plane> read_planes(const std::string &file) {
  std::ifstream in(file);
  std::vector<Plane> planes;
  std::string line;
  while (std::getline(in, line)) {
    std::istringstream text(line);
    Plane plane;
    for (auto *vector : {&plane.centre, &plane.right, &plane.up}) {
      text >> (*vector)[0] >> (*vector)[1] >> (*vector)[2];
    }
    text >> plane.mm_per_pixel >> plane.pixels;
    if (!text) {
      throw std::runtime_error(file + ": a plane needs 11 numbers: " + line);
    }
    planes.push_back(plane);
  }
  return planes;
}

Image::Pointer resample(Image *image, const Plane &plane) {
  const auto normal = itk::CrossProduct(plane.right, plane.up);
  Image::DirectionType direction;
  for (unsigned row = 0; row < 3; ++row) {
    direction[row][0] = plane.right[row];
    direction[row][1] = plane.up[row];
    direction[row][2] = normal[row];
  }
  const double half = 0.5 * (plane.pixels - 1) * plane.mm_per_pixel;
  Image::PointType origin;
  for (unsigned d = 0; d < 3; ++d) {
    origin[d] = plane.centre[d] - half * (plane.right[d] + plane.up[d]);
  }
  const double spacing[3] = {plane.mm_per_pixel, plane.mm_per_pixel, 1.0};
  using Filter = itk::ResampleImageFilter<Image, Image>;
  const auto filter = Filter::New();
  filter->SetInput(image);
  filter->SetInterpolator(itk::LinearInterpolateImageFunction<Image, double>::New());
  filter->SetSize({{plane.pixels, plane.pixels, 1}});
  filter->SetOutputOrigin(origin);
  filter->SetOutputSpacing(spacing);
  filter->SetOutputDirection(direction);
  filter->SetDefaultPixelValue(std::numeric_limits<double>::quiet_NaN());
  filter->Update();
  return filter->GetOutput();
}

int run(const std::string &image_file, const std::string &plane_file, const std::string &output) {
  const auto reader = itk::ImageFileReader<Image>::New();
  reader->SetFileName(image_file);
  reader->Update();
  std::ofstream out(output, std::ios::binary);
  for (const Plane &plane : read_planes(plane_file)) {
    const auto result = resample(reader->GetOutput(), plane);
    out.write(reinterpret_cast<const char *>(result->GetBufferPointer()),
              static_cast<std::streamsize>(sizeof(double)) * plane.pixels * plane.pixels);
  }
  out.flush();
  return out ? 0 : 1;
}

} // namespace

int main(int argc, char **argv) {
  if (argc != 4) {
    std::fputs("usage: display_itk_resample IMAGE.mha PLANES OUTPUT\n", stderr);
    return 2;
  }
  try {
    itk::MetaImageIOFactory::RegisterOneFactory();
    return run(argv[1], argv[2], argv[3]);
  } catch (const std::exception &error) {
    std::fprintf(stderr, "display_itk_resample: %s\n", error.what());
    return 1;
  }
}
