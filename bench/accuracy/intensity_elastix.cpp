#include "bench/accuracy/intensity_elastix.hpp"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include <Eigen/Geometry>

#include "casefile/volumes/volume.hpp"

namespace bregma::bench {

namespace {

namespace fs = std::filesystem;

constexpr const char *kParameters = R"((FixedInternalImagePixelType "float")
(MovingInternalImagePixelType "float")
(Registration "MultiResolutionRegistration")
(FixedImagePyramid "FixedRecursiveImagePyramid")
(MovingImagePyramid "MovingRecursiveImagePyramid")
(Interpolator "LinearInterpolator")
(ResampleInterpolator "FinalBSplineInterpolator")
(FinalBSplineInterpolationOrder 1)
(Resampler "DefaultResampler")
(Metric "AdvancedMattesMutualInformation")
(Optimizer "AdaptiveStochasticGradientDescent")
(Transform "EulerTransform")
(AutomaticScalesEstimation "true")
(AutomaticTransformInitialization "true")
(NumberOfResolutions 3)
(NumberOfHistogramBins 32)
(MaximumNumberOfIterations 250)
(NumberOfSpatialSamples 2048)
(NewSamplesEveryIteration "true")
(ImageSampler "RandomCoordinate")
(WriteResultImage "false")
)";

std::string text_of(const fs::path &file) {
  std::ostringstream out;
  out << std::ifstream(file).rdbuf();
  return out.str();
}

// Numbers after a name in a file of parameters: "(Name 1 2 3)".
std::vector<double> numbers_of(const std::string &text, const std::string &name) {
  std::vector<double> out;
  const auto at = text.find("(" + name + " ");
  if (at != std::string::npos) {
    std::istringstream in(text.substr(at + name.size() + 2));
    for (double v = 0.0; in >> v;) {
      out.push_back(v);
    }
  }
  return out;
}

} // namespace

base::Result<ElastixResult> run_elastix(const intensity::Volume &fixed, const intensity::Volume &moving) {
  if (std::system("command -v elastix > /dev/null 2>&1") != 0) { // NOLINT(cert-env33-c,concurrency-mt-unsafe)
    return base::failure("not installed: ./dev bench intensity installs it");
  }
  const fs::path folder = fs::temp_directory_path() / "bregma_bench_elastix";
  fs::remove_all(folder);
  fs::create_directories(folder);
  for (const auto &[volume, name] : {std::pair(&fixed, "fixed.nii"), std::pair(&moving, "moving.nii")}) {
    if (auto written = casefile::write_volume(folder / name, *volume); !written) {
      return tl::unexpected(written.error());
    }
  }
  std::ofstream(folder / "rigid.txt") << kParameters;
  const std::string command = "cd '" + folder.string() +
                              "' && elastix -f fixed.nii -m moving.nii -p rigid.txt -out . " +
                              "-threads 2 > log.txt 2>&1";
  if (std::system(command.c_str()) != 0) { // NOLINT(cert-env33-c,concurrency-mt-unsafe)
    return base::failure("failed: see " + (folder / "log.txt").string());
  }
  ElastixResult out;
  std::smatch match;
  const std::string log = text_of(folder / "log.txt");
  double total = 0.0;
  const std::regex level(R"(Time spent in resolution \d+ \(ITK initialization and iterating\): ([0-9.]+))");
  for (std::sregex_iterator at(log.begin(), log.end(), level), end; at != end; ++at) {
    total += std::stod((*at)[1]);
  }
  out.time_s = total;
  // x_moving = R (x - c) + t + c in LPS, R = Rz Rx Ry, from fixed to moving.
  const std::string result = text_of(folder / "TransformParameters.0.txt");
  const std::vector<double> p = numbers_of(result, "TransformParameters");
  const std::vector<double> c = numbers_of(result, "CenterOfRotationPoint");
  if (p.size() != 6 || c.size() != 3) {
    return base::failure("printed no transform: see " + folder.string());
  }
  using Eigen::AngleAxisd;
  using Eigen::Vector3d;
  const Eigen::Matrix3d R =
      (AngleAxisd(p[2], Vector3d::UnitZ()) * AngleAxisd(p[0], Vector3d::UnitX()) * AngleAxisd(p[1], Vector3d::UnitY()))
          .toRotationMatrix();
  const Vector3d centre(c[0], c[1], c[2]);
  const Vector3d t = Vector3d(p[3], p[4], p[5]) + centre - R * centre;
  const Eigen::Matrix3d flip = Vector3d(-1.0, -1.0, 1.0).asDiagonal(); // LPS to RAS
  const Eigen::Matrix3d in_ras = flip * R * flip;
  const geometry::Rigid3<geometry::frame::Source, geometry::frame::Target> T_floating_reference(in_ras, flip * t);
  out.T_reference_floating = T_floating_reference.inverse();
  return out;
}

} // namespace bregma::bench
