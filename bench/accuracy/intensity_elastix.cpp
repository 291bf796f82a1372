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

const std::string kCommon = R"((FixedInternalImagePixelType "float")
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
(NumberOfResolutions 3)
(NumberOfHistogramBins 32)
(NewSamplesEveryIteration "true")
(ImageSampler "RandomCoordinate")
(WriteResultImage "false")
)";
const std::string kRigid = R"((Transform "EulerTransform")
(AutomaticScalesEstimation "true")
(AutomaticTransformInitialization "true")
(MaximumNumberOfIterations 250)
(NumberOfSpatialSamples 2048)
)";
const std::string kNonrigid = R"((Transform "BSplineTransform")
(HowToCombineTransforms "Compose")
(GridSpacingSchedule 2 1 1)
(MaximumNumberOfIterations 500)
(NumberOfSpatialSamples 4096)
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

fs::path elastix_folder() { return fs::temp_directory_path() / "bregma_bench_elastix"; }

bool runs(const std::string &command) {
  return std::system(command.c_str()) == 0; // NOLINT(cert-env33-c,concurrency-mt-unsafe)
}

// Writes the images and runs the program; seconds, without files.
base::Result<double> register_by_elastix(const intensity::Volume &fixed, const intensity::Volume &moving,
                                         const std::string &parameters) {
  if (!runs("command -v elastix > /dev/null 2>&1")) {
    return base::failure("not installed: ./dev bench intensity installs it");
  }
  const fs::path folder = elastix_folder();
  fs::remove_all(folder);
  fs::create_directories(folder);
  for (const auto &[volume, name] : {std::pair(&fixed, "fixed.nii"), std::pair(&moving, "moving.nii")}) {
    if (auto written = casefile::write_volume(folder / name, *volume); !written) {
      return tl::unexpected(written.error());
    }
  }
  std::ofstream(folder / "parameters.txt") << parameters;
  if (!runs("cd '" + folder.string() + "' && elastix -f fixed.nii -m moving.nii -p parameters.txt -out . " +
            "-threads 2 > log.txt 2>&1")) {
    return base::failure("failed: see " + (folder / "log.txt").string());
  }
  const std::string log = text_of(folder / "log.txt");
  double total = 0.0;
  const std::regex level(R"(Time spent in resolution \d+ \(ITK initialization and iterating\): ([0-9.]+))");
  for (std::sregex_iterator at(log.begin(), log.end(), level), end; at != end; ++at) {
    total += std::stod((*at)[1]);
  }
  return total;
}

} // namespace

base::Result<ElastixResult> run_elastix(const intensity::Volume &fixed, const intensity::Volume &moving) {
  const auto time_s = register_by_elastix(fixed, moving, kCommon + kRigid);
  if (!time_s) {
    return tl::unexpected(time_s.error());
  }
  const fs::path folder = elastix_folder();
  ElastixResult out;
  out.time_s = *time_s;
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

base::Result<ElastixField> run_elastix_nonrigid(const intensity::Volume &fixed, const intensity::Volume &moving,
                                                double grid_mm, const std::vector<Eigen::Vector3d> &points_mm) {
  const auto time_s = register_by_elastix(
      fixed, moving, kCommon + kNonrigid + "(FinalGridSpacingInPhysicalUnits " + std::to_string(grid_mm) + ")\n");
  if (!time_s) {
    return tl::unexpected(time_s.error());
  }
  const fs::path folder = elastix_folder();
  {
    std::ofstream points(folder / "points.txt");
    points.precision(9);
    points << "point\n" << points_mm.size() << '\n';
    for (const Eigen::Vector3d &p : points_mm) {
      points << -p.x() << ' ' << -p.y() << ' ' << p.z() << '\n'; // LPS
    }
  }
  if (!runs("cd '" + folder.string() + "' && transformix -def points.txt -tp TransformParameters.0.txt -out . " +
            "> points_log.txt 2>&1")) {
    return base::failure("transformix failed: see " + (folder / "points_log.txt").string());
  }
  ElastixField out;
  out.time_s = *time_s;
  const std::string moved = text_of(folder / "outputpoints.txt");
  const std::string name = "OutputPoint = [";
  for (auto at = moved.find(name); at != std::string::npos; at = moved.find(name, at + 1)) {
    std::istringstream in(moved.substr(at + name.size(), 100));
    Eigen::Vector3d p;
    in >> p.x() >> p.y() >> p.z();
    out.moved_mm.emplace_back(-p.x(), -p.y(), p.z());
  }
  if (out.moved_mm.size() != points_mm.size()) {
    return base::failure("transformix wrote " + std::to_string(out.moved_mm.size()) + " of " +
                         std::to_string(points_mm.size()) + " points");
  }
  return out;
}

} // namespace bregma::bench
