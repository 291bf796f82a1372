#include "bench/accuracy/mri_runs.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>

#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "base/write_file.hpp"

namespace bregma::bench {

using namespace sim::scanner;

double average(const std::vector<double> &v) {
  double sum = 0.0;
  for (const double x : v) {
    sum += x;
  }
  return v.empty() ? std::nan("") : sum / static_cast<double>(v.size());
}

int seeds_of(const MriBenchOptions &options, int full, int quick) {
  const int by_itself = options.quick ? quick : full;
  return options.seeds > 0 ? options.seeds : by_itself;
}

PillarRun::PillarRun(MriSession &session, const std::vector<std::string> &pillars, const Protocol &protocol, int slices,
                     Images images) {
  const auto groups = [&](const char *side) {
    std::vector<std::string> out;
    for (const std::string &pillar : pillars) {
      out.push_back(pillar + side);
    }
    return out;
  };
  top = session.scan(protocol, pillar_plan(true, slices), groups("-top"));
  bottom = session.scan(protocol, pillar_plan(false, slices), groups("-bottom"));
  evaluate(session, images);
}

void PillarRun::evaluate(const MriSession &session, Images images) {
  const std::vector<mri::CoilScan> scans{top->scan, bottom->scan};
  result = mri::register_robot(session.frame(), scans, session.options(images, mri::CoilMethod::kMultiSlice));
}

Protocol small_protocol(int slices) {
  Protocol out = coil_protocol(slices);
  out.fov_mm = 128 * out.pixel_mm();
  out.matrix = 128;
  return out;
}

bool TargetError::covered() const { return mahalanobis <= uncertainty::chi_square_upper_quantile(0.05, 3.0); }

TargetError target_error(const MriSession &session,
                         const geometry::UncertainPose<mri::frame::Base, mri::frame::Device> &T_base_device,
                         const std::string &target, std::optional<ReadOuts> read_outs) {
  const int coil = session.frame().find(target);
  TargetError out;
  out.error_mm = session.error_at(coil, T_base_device.pose, Images::kOurs, coil_protocol(60),
                                  tree_plan(Plane::kCoronal), read_outs.value_or(session.read_outs()));
  const Vector3d at = session.frame().coils[static_cast<std::size_t>(coil)].position_mm;
  Eigen::Matrix3d covariance = uncertainty::tre_covariance(T_base_device.covariance, at);
  const auto known = session.field()->assess(T_base_device.pose.inverse() * at);
  const Eigen::Matrix3d R = T_base_device.pose.rotation_matrix();
  covariance += R * known.sigma_mm.cwiseAbs2().asDiagonal() * R.transpose();
  out.mahalanobis = uncertainty::mahalanobis_squared(covariance, out.error_mm);
  out.bound_95_mm = uncertainty::ellipsoid_95(covariance).semi_axes_mm[0];
  return out;
}

void add_study(Report &report, const std::string &name, const Study &study) {
  report.add(figure(name + ", FRE", average(study.fre_mm), "mm"));
  report.add(figure(name + ", TRE at " + kTarget, average(study.tre_mm), "mm"));
  report.add(figure(name + ", found", 100.0 * study.found / std::max(1, study.runs), "%"));
}

void add_run(Study &study, const MriSession &session, const mri::RobotRegistration &r) {
  ++study.runs;
  if (r.verdict == mri::RegistrationVerdict::kFound) {
    ++study.found;
    study.fre_mm.push_back(r.fre_mm);
    study.tre_mm.push_back(target_error(session, r.T_base_device).error_mm.norm());
  }
}

void write_picture(const MriBenchOptions &options, const std::string &name, const base::Plot &plot) {
  if (options.pictures.empty()) {
    return;
  }
  const auto file = std::filesystem::path(options.pictures) / (name + ".svg");
  if (auto written = base::write_file(file, base::plot_svg(plot, {900, 340})); !written) {
    throw std::runtime_error(written.error().message);
  }
}

} // namespace bregma::bench
