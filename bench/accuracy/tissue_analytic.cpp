// The solver compared with analytic solutions: the figures of issue "The brain under the probe". The only random
// numbers are the jitter of the meshes, with its seed in tests/support/tissue_problems.cpp.
#include <cmath>

#include "bench/accuracy/tissue_parts.hpp"
#include "tests/support/tissue_problems.hpp"

namespace bregma::bench {
namespace {

using test::elastic;
using tissue::Law;

constexpr double kYoung_Pa = 2100.0;

std::string with(const std::string &name, double poisson) {
  return name + ".nu" + std::to_string(std::lround(1000.0 * poisson));
}

tissue::Material brain(Law law, double poisson) {
  tissue::Material material = elastic(law, kYoung_Pa, poisson);
  material.ogden_alpha = -4.7;
  return material;
}

void homogeneous(Report &report) {
  report.note("homogeneous: blocks with disordered inner nodes; errors against closed forms in principal stretches");
  Eigen::Matrix3d some;
  some << 1.10, 0.20, -0.05, 0.03, 0.90, 0.10, 0.00, -0.08, 1.05;
  Eigen::Matrix3d shear = Eigen::Matrix3d::Identity();
  shear(0, 1) = 0.4;
  for (const Law law : {Law::kNeoHookean, Law::kOgden}) {
    const std::string name = law == Law::kOgden ? "ogden" : "neo_hookean";
    for (const double poisson : {0.45, 0.49, 0.499}) {
      const test::PatchAnswer patch = test::patch(brain(law, poisson), some);
      report.add(at_most(with("patch." + name, poisson) + ".stress", kPercent * patch.stress_error, "%", 1.0));
    }
    const test::PatchAnswer sheared = test::patch(brain(law, 0.45), shear);
    report.add(at_most("shear." + name,
                       kPercent * (sheared.nominal_Pa - sheared.reference_Pa).norm() / sheared.reference_Pa.norm(), "%",
                       1.0));
    for (const double stretch : {0.6, 0.8, 1.3, 1.8}) {
      const test::UniaxialAnswer bar = test::uniaxial(brain(law, 0.45), stretch);
      report.add(at_most("uniaxial." + name + "." + std::to_string(std::lround(kPercent * stretch)) + "%.force",
                         kPercent * bar.force_N.error(), "%", 1.0));
    }
  }
}

void relaxation(Report &report) {
  tissue::Material material = elastic(Law::kNeoHookean, kYoung_Pa, 0.45);
  material.prony = {{0.450, 0.5}, {0.365, 50.0}};
  double worst = 0.0;
  for (const test::Compared &stress : test::relaxing_bar(material, {0.05, 0.2, 1.0, 5.0, 20.0, 80.0})) {
    worst = std::max(worst, stress.error());
  }
  report.note("relaxation: a bar held at 0.2 %, Miller & Chinzei's terms, 0.05 to 80 s; the largest error");
  report.add(at_most("relaxation.bar", kPercent * worst, "%", 1.0));
}

// A problem on successively refined meshes.
template <class Problem>
ErrorCurve refine(Report &report, const std::string &name, const std::vector<int> &meshes, double limit,
                  const Problem &problem) {
  ErrorCurve curve{name, {}, {}};
  for (const int mesh : meshes) {
    const test::FieldAnswer answer = problem(mesh);
    curve.edge_mm.push_back(answer.edge_mm);
    curve.error.push_back(answer.displacement_error);
    std::string line(160, '\0');
    line.resize(static_cast<std::size_t>(std::snprintf(
        line.data(), line.size(),
        "%-20s %6d tetrahedra, edge %5.2f mm: field %6.3f %%, stress %6.2f %%, known %6.3f %%%s", name.c_str(),
        answer.elements, answer.edge_mm, kPercent * answer.displacement_error, kPercent * answer.stress_error,
        kPercent * answer.known.error(), answer.relaxation.converged ? "" : " (NOT converged)")));
    report.note(line);
    if (mesh == meshes.back()) {
      report.add(at_most(name, kPercent * answer.known.error(), "%", limit));
    }
  }
  report.add(figure(name + ".order", curve.order(), ""));
  return curve;
}

} // namespace

double ErrorCurve::order() const {
  const std::size_t n = error.size();
  return std::log(error[n - 2] / error[n - 1]) / std::log(edge_mm[n - 2] / edge_mm[n - 1]);
}

void analytic_figures(Report &report, const TissueBenchOptions &options, const std::string &convergence_picture) {
  homogeneous(report);
  relaxation(report);
  report.note(
      "field: error of the displacements, RMS by RMS; known: inner radius' growth (Lame), deflection of the end");
  const std::vector<int> layers = options.quick ? std::vector{2, 4, 8} : std::vector{2, 4, 8, 12};
  const std::vector<int> rows = options.quick ? std::vector{4, 8} : std::vector{4, 8, 16};
  std::vector<ErrorCurve> curves;
  for (const double poisson : {0.45, 0.49, 0.499}) {
    curves.push_back(refine(report, with("sphere", poisson), layers, 1.0,
                            [&](int n) { return test::pressurised_sphere(poisson, n); }));
  }
  for (const double poisson : {0.45, 0.49, 0.499}) {
    // 5 % shows that the element does not lock. On the finest mesh the thesis' brain meets the 1 % of the other
    // problems.
    const double limit = poisson == 0.45 && !options.quick ? 1.0 : 5.0;
    curves.push_back(refine(report, with("bending", poisson), rows, limit,
                            [&](int n) { return test::plane_strain_beam(Law::kNeoHookean, poisson, n); }));
  }
  if (!options.quick) {
    const test::Compared blown = test::blown_sphere(0.499, 8);
    report.note("blown sphere: inner radius times 1.5, neo-Hookean, nu 0.499 against the incompressible pressure");
    report.add(at_most("blown_sphere.pressure", kPercent * blown.error(), "%", 1.0));
    report.note("slender bar: ten times as long as high, 12 cells over its height; Timoshenko's beam");
    report.add(figure("slender_bar", kPercent * test::slender_cantilever(0.45, 12).error(), "%"));
  }
  if (!convergence_picture.empty()) {
    draw_convergence(curves, convergence_picture);
  }
}

} // namespace bregma::bench
