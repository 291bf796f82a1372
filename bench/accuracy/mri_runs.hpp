// Registrations of the robot in simulated sessions, and their true errors: what the parts of bench_mri share.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/plots.hpp"
#include "bench/accuracy/mri_parts.hpp"
#include "bench/accuracy/mri_session.hpp"

namespace bregma::bench {

// The middle coil of the tree as target.
inline constexpr const char *kTarget = "tree-2";

[[nodiscard]] double average(const std::vector<double> &v); // NaN of nothing
[[nodiscard]] int seeds_of(const MriBenchOptions &options, int full, int quick);

// Top and bottom of these pillars, and their registration.
struct PillarRun {
  std::unique_ptr<StackPair> top, bottom;
  mri::RobotRegistration result;

  PillarRun(MriSession &session, const std::vector<std::string> &pillars, const sim::scanner::Protocol &protocol,
            int slices, Images images);
  void evaluate(const MriSession &session, Images images);
};

// Slices and pixels as large as the paper's, around the coils alone.
[[nodiscard]] sim::scanner::Protocol small_protocol(int slices);

struct TargetError {
  Vector3d error_mm = Vector3d::Zero();
  double mahalanobis = 0.0; // squared, by the predicted covariance
  double bound_95_mm = 0.0;
  [[nodiscard]] bool covered() const; // by the region of 95 %
};
// Registration's own error at a place that the field maps by itself: what the prediction covers. In an image of one
// read-out, or with the read-outs that the field was mapped with.
[[nodiscard]] TargetError
target_error(const MriSession &session,
             const geometry::UncertainPose<mri::frame::Base, mri::frame::Device> &T_base_device,
             const std::string &target = kTarget, std::optional<ReadOuts> read_outs = std::nullopt);

struct Study {
  std::vector<double> fre_mm, tre_mm;
  int found = 0, runs = 0;
};
void add_study(Report &report, const std::string &name, const Study &study);
void add_run(Study &study, const MriSession &session, const mri::RobotRegistration &r);

// Writes a figure of the documentation, where --pictures names a folder.
void write_picture(const MriBenchOptions &options, const std::string &name, const base::Plot &plot);

} // namespace bregma::bench
