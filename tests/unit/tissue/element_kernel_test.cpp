// Every kernel compared with the laws in double precision (constitutive.hpp), tetrahedron by tetrahedron.
#include "algorithms/tissue/solver/element_kernel.hpp"

#include <array>
#include <cmath>
#include <random>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "algorithms/tissue/material/constitutive.hpp"
#include "tests/support/tissue_problems.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr unsigned kKernelSeed = 20261125;
constexpr std::size_t kPacks = 16;

// Tetrahedra without common nodes, each with its own deformation gradient.
struct Pieces {
  std::vector<ElementPack> packs = std::vector<ElementPack>(kPacks);
  std::vector<NodeVector> nodes;
  std::vector<Matrix3d> gradient; // deformation gradient
  std::vector<Matrix3d> shape;    // rows: gradients of nodes 1 to 3 (1/m)
  std::vector<double> volume_m3, pressure_Pa;
};

Pieces make_pieces(double size, std::mt19937 &rng) {
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  const auto random = [&] { return Matrix3d(Matrix3d::NullaryExpr([&] { return unit(rng); })); };
  Pieces out;
  for (std::size_t e = 0; e < kPacks * kPack; ++e) {
    // About 5 mm, positively oriented; deformed and rotated, but not close to kInvertedVolume.
    const Matrix3d edges = 0.005 * (Matrix3d::Identity() + 0.3 * random());
    Matrix3d f;
    do {
      const Eigen::HouseholderQR<Matrix3d> qr(random());
      const Matrix3d q = qr.householderQ();
      const Matrix3d turn = q.determinant() > 0.0 ? q : Matrix3d(-q);
      f = (size > 0.1 ? turn : Matrix3d(Matrix3d::Identity())) * (Matrix3d::Identity() + size * random());
    } while (f.determinant() < 0.5);
    const Vector3d base = 0.01 * Vector3d(unit(rng), unit(rng), unit(rng));
    const double pressure = 300.0 * unit(rng);
    ElementPack &pack = out.packs[e / kPack];
    const std::size_t lane = e % kPack;
    Matrix3d h; // rounded to floats
    std::array<NodeVector, 4> u;
    for (int i = 0; i < 4; ++i) {
      const Vector3d at = i == 0 ? base : Vector3d(base + (f - Matrix3d::Identity()) * edges.col(i - 1));
      u[static_cast<std::size_t>(i)] = {static_cast<float>(at.x()), static_cast<float>(at.y()),
                                        static_cast<float>(at.z()), static_cast<float>(pressure * (1.0 + 0.1 * i))};
      pack.node[i][lane] = static_cast<int>(out.nodes.size());
      out.nodes.push_back(u[static_cast<std::size_t>(i)]);
    }
    const Matrix3d shape = edges.inverse();
    h.setZero();
    double mean = 0.0;
    for (int i = 0; i < 4; ++i) {
      const NodeVector &n = u[static_cast<std::size_t>(i)];
      mean += 0.25 * static_cast<double>(n.w);
      if (i > 0) {
        const Vector3d way(static_cast<double>(n.x) - static_cast<double>(u[0].x),
                           static_cast<double>(n.y) - static_cast<double>(u[0].y),
                           static_cast<double>(n.z) - static_cast<double>(u[0].z));
        h += way * shape.row(i - 1);
        for (int d = 0; d < 3; ++d) {
          pack.gradient[i - 1][d][lane] = static_cast<float>(shape(i - 1, d));
        }
      }
    }
    pack.volume_m3[lane] = static_cast<float>(edges.determinant() / 6.0);
    out.gradient.push_back(Matrix3d::Identity() + h);
    out.shape.push_back(shape);
    out.volume_m3.push_back(edges.determinant() / 6.0);
    out.pressure_Pa.push_back(mean);
  }
  return out;
}

struct Case {
  Law law;
  double alpha;
  double size; // size of the deformation
};

class EveryKernel : public testing::TestWithParam<Case> {
protected:
  void SetUp() override {
    material = test::elastic(GetParam().law, 2100.0, 0.45);
    material.ogden_alpha = GetParam().alpha;
    RecordProperty("seed", kKernelSeed);
    pieces = make_pieces(GetParam().size, rng);
    forces.resize(pieces.nodes.size());
    volumes.resize(pieces.nodes.size());
    work.packs = pieces.packs;
    work.nodes = pieces.nodes.data();
    work.shear_Pa = static_cast<float>(material.shear_Pa());
    work.ogden_alpha = static_cast<float>(material.ogden_alpha);
  }
  void clear() {
    forces.assign(forces.size(), {});
    volumes.assign(volumes.size(), 0.0F);
    work.force_N = forces.data();
    work.volume_change_m3 = volumes.data();
  }
  // Largest difference from the forces of the relaxed shear stress over all tetrahedra, relative to the largest force.
  template <class Left> double force_error(const Left &left) const {
    double worst = 0.0;
    for (std::size_t e = 0; e < pieces.gradient.size(); ++e) {
      const Matrix3d &f = pieces.gradient[e];
      const Matrix3d shear = left(shear_stress_Pa(material, f));
      const double p = pieces.pressure_Pa[e];
      const Matrix3d first = material.law == Law::kLinear
                                 ? Matrix3d(shear + p * Matrix3d::Identity())
                                 : Matrix3d(f * shear + p * f.determinant() * f.inverse().transpose());
      const Matrix3d wanted = -pieces.volume_m3[e] * first * pieces.shape[e].transpose(); // columns: nodes 1 to 3
      const auto at = [&](std::size_t i) {
        const NodeVector &n = forces[4 * e + i];
        return Vector3d(static_cast<double>(n.x), static_cast<double>(n.y), static_cast<double>(n.z));
      };
      const double scale = wanted.cwiseAbs().maxCoeff();
      for (std::size_t i = 0; i < 3; ++i) {
        worst = std::max(worst, (at(i + 1) - wanted.col(static_cast<int>(i))).cwiseAbs().maxCoeff() / scale);
      }
      worst = std::max(worst, (at(0) + wanted.rowwise().sum()).cwiseAbs().maxCoeff() / scale);
    }
    return worst;
  }

  std::mt19937 rng{kKernelSeed};
  Material material;
  Pieces pieces;
  std::vector<NodeVector> forces;
  std::vector<float> volumes;
  ElementWork work;
};

// For differences of energies, which floats resolve only if they are large.
class LargeDeformation : public EveryKernel {};

TEST_P(EveryKernel, ComputesTheForcesOfTheLaw) {
  for (const ElementKernel &kernel : element_kernels()) {
    clear();
    const ElementSums sums = kernel.add_forces(work, material.law);
    EXPECT_EQ(sums.inverted, 0) << kernel.name;
    EXPECT_LT(force_error([](const Matrix3d &s) { return s; }), 3e-5) << kernel.name;
  }
}

TEST_P(EveryKernel, ComputesTheChangesOfVolume) {
  for (const ElementKernel &kernel : element_kernels()) {
    clear();
    kernel.add_volumes(work, material.law);
    for (std::size_t e = 0; e < pieces.gradient.size(); ++e) {
      const double change = pressure_Pa(material, pieces.gradient[e]) / material.bulk_Pa();
      for (std::size_t i = 0; i < 4; ++i) {
        EXPECT_NEAR(static_cast<double>(volumes[4 * e + i]), 0.25 * pieces.volume_m3[e] * change,
                    2e-6 * pieces.volume_m3[e] * std::max(GetParam().size, 0.01))
            << kernel.name;
      }
    }
  }
}

TEST_P(EveryKernel, SupportsElementPressure) {
  for (NodeVector &node : pieces.nodes) {
    node.w = 0.0F; // the rest state is computed from it
  }
  for (std::size_t e = 0; e < pieces.gradient.size(); ++e) {
    pieces.pressure_Pa[e] = pressure_Pa(material, pieces.gradient[e]);
  }
  work.element_bulk_Pa = static_cast<float>(material.bulk_Pa());
  for (const ElementKernel &kernel : element_kernels()) {
    clear();
    (void)kernel.add_forces(work, material.law);
    EXPECT_LT(force_error([](const Matrix3d &s) { return s; }), 3e-5) << kernel.name;
  }
}

// The force is the negative gradient of the kernel's energy: central difference along the forces.
TEST_P(LargeDeformation, TheForceIsTheGradientOfTheEnergy) {
  for (const bool mirrored : {false, true}) {
    if (mirrored && material.law == Law::kLinear) {
      continue; // has no inverted configuration
    }
    work.element_bulk_Pa = mirrored ? 0.0F : static_cast<float>(0.5 * material.bulk_Pa());
    if (mirrored) {
      for (std::size_t e = 0; e < pieces.gradient.size(); ++e) {
        // The last corner moves through the opposite face.
        NodeVector &last = pieces.nodes[4 * e + 3];
        const Vector3d way =
            -(1.2 + 0.5 * static_cast<double>(e % 3)) * pieces.gradient[e] * pieces.shape[e].inverse().col(2);
        last.x += static_cast<float>(way.x());
        last.y += static_cast<float>(way.y());
        last.z += static_cast<float>(way.z());
      }
    }
    for (NodeVector &node : pieces.nodes) {
      node.w = 0.0F;
    }
    for (const ElementKernel &kernel : element_kernels()) {
      const std::vector<NodeVector> here = pieces.nodes;
      const auto energy = [&] {
        clear();
        const ElementSums sums = kernel.add_forces(work, material.law);
        EXPECT_EQ(sums.inverted, mirrored ? static_cast<int>(pieces.gradient.size()) : 0) << kernel.name;
        return sums.elastic_J;
      };
      (void)energy();
      const std::vector<NodeVector> force = forces;
      float largest = 0.0F;
      for (const NodeVector &f : force) {
        largest = std::max({largest, std::abs(f.x), std::abs(f.y), std::abs(f.z)});
      }
      const float by = 3e-5F / largest; // m/N
      double expected = 0.0;
      for (const NodeVector &f : force) {
        expected -= static_cast<double>(by * (f.x * f.x + f.y * f.y + f.z * f.z));
      }
      const auto energy_at = [&](float along) {
        for (std::size_t i = 0; i < force.size(); ++i) {
          pieces.nodes[i].x = here[i].x + along * by * force[i].x;
          pieces.nodes[i].y = here[i].y + along * by * force[i].y;
          pieces.nodes[i].z = here[i].z + along * by * force[i].z;
        }
        return energy();
      };
      const double difference = 0.5 * (energy_at(1.0F) - energy_at(-1.0F));
      pieces.nodes = here;
      work.nodes = pieces.nodes.data();
      EXPECT_NEAR(difference / expected, 1.0, 0.01) << kernel.name << (mirrored ? ", mirrored" : "");
    }
  }
}

TEST_P(EveryKernel, RelaxesByPronysSeries) {
  const std::array<PronyStep, 2> prony{{{0.9F, 0.45F * 0.1F}, {0.99F, 0.365F * 0.01F}}};
  for (const ElementKernel &kernel : element_kernels()) {
    std::vector<RelaxedPack> relaxed(2 * kPacks);
    work.relaxed = relaxed.data();
    work.prony = prony;
    double taken[2] = {0.0, 0.0};
    for (int step = 0; step < 20; ++step) {
      clear();
      (void)kernel.add_forces(work, material.law);
      for (std::size_t k = 0; k < 2; ++k) {
        taken[k] = static_cast<double>(prony[k].decay) * taken[k] + static_cast<double>(prony[k].gain);
      }
      EXPECT_LT(force_error([&](const Matrix3d &s) { return Matrix3d((1.0 - taken[0] - taken[1]) * s); }), 3e-5)
          << kernel.name << ", step " << step;
    }
  }
}

TEST_P(EveryKernel, PadsAPackWithoutEffect) {
  ElementPack empty{};
  work.packs = {&empty, 1};
  for (const ElementKernel &kernel : element_kernels()) {
    clear();
    kernel.add_volumes(work, material.law);
    const ElementSums sums = kernel.add_forces(work, material.law);
    EXPECT_EQ(sums.elastic_J, 0.0) << kernel.name;
    EXPECT_EQ(sums.inverted, 0) << kernel.name;
    EXPECT_EQ(forces[0].x, 0.0F) << kernel.name;
    EXPECT_EQ(volumes[0], 0.0F) << kernel.name;
  }
}

INSTANTIATE_TEST_SUITE_P(AllLaws, LargeDeformation,
                         testing::Values(Case{Law::kNeoHookean, 2.0, 0.3}, Case{Law::kOgden, -4.7, 0.3},
                                         Case{Law::kOgden, 8.0, 0.3}, Case{Law::kLinear, 2.0, 0.3}));

INSTANTIATE_TEST_SUITE_P(AllLaws, EveryKernel,
                         testing::Values(Case{Law::kNeoHookean, 2.0, 0.3}, Case{Law::kNeoHookean, 2.0, 0.003},
                                         Case{Law::kOgden, -4.7, 0.3}, Case{Law::kOgden, -4.7, 0.003},
                                         Case{Law::kOgden, 8.0, 0.3}, Case{Law::kOgden, 2.0, 0.3},
                                         Case{Law::kLinear, 2.0, 0.3}, Case{Law::kLinear, 2.0, 0.003}));

} // namespace
} // namespace bregma::tissue
