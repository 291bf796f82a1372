// The head of the surface benchmarks: a case's scalp, its regions, and the samples that a pointer takes from it.
#pragma once

#include <random>
#include <string>
#include <vector>

#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/surface/triangle_mesh.hpp"
#include "bench/record.hpp"

namespace bregma::bench {

using registration::PairedPose;
using registration::Vector3d;

struct Head {
  surface::TriangleMesh mesh;
  std::vector<Vector3d> face; // the 3,000 vertices with the largest y - 0.3 z (RAS mm): brows to chin, ear to ear
};
// Throws std::runtime_error when the case has no scalp.
[[nodiscard]] Head load_head(const std::string &case_folder);

// Data of one run: true points on the head, and their samples in a frame of their own.
struct Trace {
  std::vector<Vector3d> true_mm;
  std::vector<Vector3d> source_mm;
  PairedPose T_target_source;

  [[nodiscard]] double rmse_mm(const PairedPose &estimate) const { return rmse_mm(estimate, true_mm); }
  [[nodiscard]] double rmse_mm(const PairedPose &estimate, const std::vector<Vector3d> &at_mm) const;
  // [NeuroGuide, eq. 1]: displacement of the end of a 100 mm line along x by the rotation's error.
  [[nodiscard]] double error_at_10cm_mm(const PairedPose &estimate) const;
};

// In all axes, or along the depth of the face alone: RAS y. That is the "Z axis" of [NeuroGuide], whose sensor looks
// down on a face that lies on its back.
enum class Noise { kAll, kDepth };
// Samples of points on the head under a pose anywhere in SO(3), 200 mm away.
[[nodiscard]] Trace take_trace(std::vector<Vector3d> places_mm, double sigma_mm, Noise noise, std::mt19937 &rng);

// `count` points on one side of the head, uniform by area.
[[nodiscard]] std::vector<Vector3d> side_of(const Head &head, std::size_t count, bool left, std::mt19937 &rng);

// A start perturbed by this rotation about a random axis through the head's centre, and by this translation in a random
// direction.
[[nodiscard]] PairedPose perturbed_start(const PairedPose &truth, const Vector3d &middle_mm, double angle_rad,
                                         double distance_mm, std::mt19937 &rng);

// CPU time of the calling thread, ms, which other load does not affect.
[[nodiscard]] double thread_ms();

} // namespace bregma::bench
