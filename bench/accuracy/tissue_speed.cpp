// Wall time of the explicit solver, as the minimum of several runs because of other load. The lower bound is the time
// in which one thread reads the bytes that a step must read, measured in the same run.
#include <algorithm>
#include <chrono>
#include <cmath>

#include "algorithms/tissue/solver/explicit_solver.hpp"
#include "bench/accuracy/tissue_parts.hpp"

namespace bregma::bench {
namespace {

using tissue::ElementKernel;
using tissue::ElementPack;
using tissue::ExplicitSolver;
using tissue::Material;

constexpr double kEdge_mm = 5.0;
constexpr double kPublicTled_ms = 1.40; // a public TLED code, 20,000 neo-Hookean tetrahedra (the issue)

double wall_s() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

tissue::TetMesh block_of(int elements) {
  const int cells = static_cast<int>(std::lround(std::cbrt(elements / 6.0)));
  return tissue::block_mesh({cells, cells, cells}, Eigen::Vector3d::Constant(kEdge_mm * cells));
}

struct Cost {
  int elements = 0;
  double step_ms = 0.0;
  double stable_step_ms = 0.0;
  [[nodiscard]] double ratio() const { return stable_step_ms / step_ms; } // simulated time over wall time
};

Cost cost_of(int elements, const Material &material, int threads, const ElementKernel *kernel, int runs) {
  tissue::SolverOptions options;
  options.threads = threads;
  options.kernel = kernel;
  ExplicitSolver solver(block_of(elements), material, options);
  // One displaced node: the cost of a step does not depend on the displacements, but all zeros might be faster.
  solver.set_displacement_mm(solver.nodes() / 2, {0.2, 0.1, -0.2});
  const int steps = std::clamp(2000000 / solver.elements(), 20, 400);
  solver.advance(steps);
  Cost cost{solver.elements(), 1e9, 0.0};
  for (int run = 0; run < runs; ++run) {
    const double begin = wall_s();
    solver.advance(steps);
    cost.step_ms = std::min(cost.step_ms, 1e3 * (wall_s() - begin) / steps);
  }
  cost.stable_step_ms = 1e3 * solver.step_s();
  return cost;
}

// Reads the packs twice, like the two passes of a step.
double floor_ms(int elements) {
  std::vector<ElementPack> packs(static_cast<std::size_t>(elements) / tissue::kPack);
  const auto *words = reinterpret_cast<const std::uint64_t *>(packs.data());
  const std::size_t count = packs.size() * sizeof(ElementPack) / sizeof(std::uint64_t);
  double best = 1e9;
  volatile std::uint64_t sink = 0;
  for (int run = 0; run < 20; ++run) {
    const double begin = wall_s();
    for (int pass = 0; pass < 2; ++pass) {
      std::uint64_t sum = 0;
      for (std::size_t i = 0; i < count; ++i) {
        sum ^= words[i];
      }
      sink = sink + sum;
    }
    best = std::min(best, 1e3 * (wall_s() - begin));
  }
  return best;
}

} // namespace

void speed_figures(Report &report, const TissueBenchOptions &options) {
  const int runs = options.quick ? 5 : 20;
  const Material &thesis = tissue::named_material("thesis");
  report.note("speed: blocks of 5 mm cells, the thesis' brain (neo-Hookean), best of several runs; a public TLED code "
              "takes 1.40 ms for the first figure");
  const Cost two = cost_of(20250, thesis, 2, nullptr, runs);
  report.add(
      with_peer(at_most("speed.step.20k.2_threads", two.step_ms, "ms", 0.4), kPublicTled_ms, "public TLED code"));
  report.add(figure("speed.step.20k.floor", floor_ms(20250), "ms"));
  report.add(at_least("speed.ratio.20k.2_threads", two.ratio(), "simulated s / s", 1.0));
  report.add(
      at_least("speed.ratio.50k.2_threads", cost_of(50000, thesis, 2, nullptr, runs).ratio(), "simulated s / s", 0.5));
  for (const ElementKernel &kernel : tissue::element_kernels()) {
    for (const int threads : {1, 2}) {
      const Cost cost = cost_of(20250, thesis, threads, &kernel, runs);
      report.add(figure("speed.step.20k." + std::string(kernel.name) + "." + std::to_string(threads) + "_threads",
                        cost.step_ms, "ms"));
    }
  }
  for (const int elements : {5000, 10000, 20000, 50000, 100000}) {
    for (const int threads : {1, 2}) {
      const Cost cost = cost_of(elements, thesis, threads, nullptr, options.quick ? 3 : runs);
      report.add(figure("speed.rate." + std::to_string(cost.elements) + "." + std::to_string(threads) + "_threads",
                        1e-3 * cost.elements / cost.step_ms, "million element steps/s"));
    }
  }
  Material viscous = thesis;
  viscous.prony = {{0.450, 0.5}, {0.365, 50.0}};
  Material ogden = tissue::named_material("miller-chinzei");
  report.add(figure("speed.step.20k.ogden_prony.2_threads", cost_of(20250, ogden, 2, nullptr, runs).step_ms, "ms"));
  ogden.prony.clear();
  report.add(figure("speed.step.20k.ogden.2_threads", cost_of(20250, ogden, 2, nullptr, runs).step_ms, "ms"));
  report.add(figure("speed.step.20k.prony.2_threads", cost_of(20250, viscous, 2, nullptr, runs).step_ms, "ms"));
}

} // namespace bregma::bench
