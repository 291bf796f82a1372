// The verdict on heads that were not used to set its thresholds: rates of correct, undecided and wrong verdicts.
#include <array>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <stdexcept>

#include "algorithms/registration/surface/global_surface.hpp"
#include "bench/accuracy/registration_head.hpp"
#include "bench/accuracy/registration_parts.hpp"
#include "casefile/surface_files/surface_file.hpp"
#include "casefile/volumes/surface.hpp"
#include "casefile/volumes/volume.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::bench {

namespace {

using namespace registration;

constexpr unsigned kHeadSeed = 20260316;
constexpr double kRight_mm = 2.0;

// A CT template (a mean of older people), SPM's scalp, and a smoothed segmentation of Colin27 by another program.
// Missing files are skipped.
const std::vector<std::string> kOtherHeads{"../shared/data/images/mni/scct.nii.gz",
                                           "../shared/data/images/mni/scalp_2562.surf.gii",
                                           "../shared/data/meshes/colin27/colin27_outer_skin_surface.asc"};

// Centres the bounding box at the origin, so that the sides are x < 0 and x > 0.
surface::TriangleMesh read_head(const std::string &file) {
  const bool image = file.ends_with(".nii.gz") || file.ends_with(".nii") || std::filesystem::is_directory(file);
  surface::TriangleMesh mesh;
  if (image) {
    const auto volume = casefile::read_volume(file);
    if (!volume) {
      throw std::runtime_error(volume.error().message);
    }
    auto scalp = casefile::extract_surface(*volume, casefile::scalp_options());
    if (!scalp) {
      throw std::runtime_error(file + ": " + scalp.error().message);
    }
    mesh = std::move(scalp->mesh);
  } else {
    auto surface = casefile::read_surface(file);
    if (!surface) {
      throw std::runtime_error(surface.error().message);
    }
    mesh = std::move(surface->mesh);
  }
  const surface::SurfaceModel box(mesh);
  for (Vector3d &v : mesh.vertices_mm) {
    v -= box.centre_mm();
  }
  return mesh;
}

struct Counts {
  int found = 0, ambiguous = 0, refused = 0;
  int wrong = 0;                // found, with an error of more than 10 mm
  int hesitated = 0;            // not found, although the error is below 2 mm
  std::array<int, 6> reasons{}; // per VerdictReason
};

Counts try_region(GlobalRegistration &global, const surface::TriangleMesh &mesh, std::size_t points, int runs,
                  const std::function<bool(const Vector3d &, int)> &wanted) {
  std::mt19937 rng(kHeadSeed);
  Counts out;
  for (int run = 0; run < runs; ++run) {
    std::vector<Vector3d> places;
    for (const auto &spot : test::spots(mesh, points, rng, [&](const Vector3d &p) { return wanted(p, run); })) {
      places.push_back(spot.point_mm);
    }
    const Trace trace = take_trace(std::move(places), 1.0, Noise::kAll, rng);
    const GlobalResult &result = global.locate(trace.source_mm);
    const double rmse_mm = trace.rmse_mm(result.T_target_source);
    const bool found = result.verdict == Verdict::kFound;
    out.found += found ? 1 : 0;
    out.ambiguous += result.verdict == Verdict::kAmbiguous ? 1 : 0;
    out.refused += result.verdict == Verdict::kRefused ? 1 : 0;
    out.wrong += found && rmse_mm > kWrong_mm ? 1 : 0;
    out.hesitated += !found && rmse_mm <= kRight_mm ? 1 : 0;
    ++out.reasons[static_cast<std::size_t>(result.reason)];
  }
  return out;
}

std::string line(const char *region, std::size_t points, const Counts &c) {
  std::array<char, 200> out{};
  std::snprintf(out.data(), out.size(), "  %-12s %5zu | %5d %9d %7d %5d | %6d | %6d %6d %6d %6d", region, points,
                c.found, c.ambiguous, c.refused, c.wrong, c.hesitated, c.reasons[2], c.reasons[3], c.reasons[4],
                c.reasons[5]);
  return out.data();
}

void try_head(Report &report, const std::string &file, int runs) {
  const surface::TriangleMesh mesh = read_head(file);
  const surface::SurfaceModel surface(mesh);
  const surface::SurfaceField field(surface);
  GlobalOptions options;
  options.threads = kThreads;
  GlobalRegistration global(field, options);
  const double front = 0.35 * surface.high_mm().y();
  const double top = 0.55 * surface.high_mm().z();
  const auto side = [](const Vector3d &p, int run) { return (p.x() < 0.0) == (run % 2 == 0); };
  const auto face = [front](const Vector3d &p, int /*run*/) { return p.y() - 0.3 * p.z() > front; };
  const auto vault = [top](const Vector3d &p, int /*run*/) { return p.z() > top; };
  report.note(file + ": " + std::to_string(mesh.vertices_mm.size()) + " vertices; of " + std::to_string(runs) +
              " each, noise 1 mm, seed " + std::to_string(kHeadSeed) + ":");
  report.note(
      "  region      points | found ambiguous refused wrong | not found within 2 mm | fits badly, another pose, "
      "slides, no feature");
  struct Study {
    const char *region;
    std::size_t points;
    std::function<bool(const Vector3d &, int)> wanted;
  };
  int wrong = 0;
  int vaults_found = 0;
  const std::string name = "surface.head." + std::filesystem::path(file).stem().stem().string();
  for (const Study &study : {Study{"side", 60, side}, Study{"side", 150, side}, Study{"side", 500, side},
                             Study{"face", 60, face}, Study{"face", 150, face}, Study{"vault", 150, vault}}) {
    const Counts counts = try_region(global, mesh, study.points, runs, study.wanted);
    report.note(line(study.region, study.points, counts));
    wrong += counts.wrong;
    if (std::string(study.region) == "vault") {
      vaults_found = counts.found;
    } else {
      report.add(figure(name + "." + study.region + std::to_string(study.points) + ".found",
                        100.0 * counts.found / runs, "%"));
    }
  }
  report.add(at_most(name + ".wrong_as_found", wrong, "runs", 0.0));
  report.add(at_most(name + ".vault_as_found", vaults_found, "runs", 0.0));
}

} // namespace

void head_figures(Report &report, const RegistrationBenchOptions &options) {
  const std::vector<std::string> &files = options.heads.empty() ? kOtherHeads : options.heads;
  Progress progress("other heads", static_cast<int>(files.size()));
  for (const std::string &file : files) {
    progress.step();
    if (options.heads.empty() && !std::filesystem::exists(file)) {
      report.note(file + " is not here: its figures are left out");
    } else {
      try_head(report, file, options.quick ? 10 : 100);
    }
  }
}

} // namespace bregma::bench
